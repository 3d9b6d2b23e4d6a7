"""Whether a reader can save all that a page shows: charts, pictures and tables."""

from typing import Any

OFFERED = """() => {
    const offered = button => {
        if (!button) return '';
        button.click();
        const forms = [...document.querySelectorAll('.menu button')].map(one => one.textContent).join(' ');
        button.click();
        return forms;
    };
    const ours = one => !one.closest('.panel, #pictures, [aria-hidden] .pen');
    const toolsOf = table => {
        const place = table.closest('.scroll') ?? table;
        return [place.previousElementSibling, place.nextElementSibling].find(one => one?.matches('.tools'));
    };
    const tables = [...document.querySelectorAll('table')].filter(ours).map(one => [
        'table', one.caption?.textContent ?? 'no caption',
        offered(toolsOf(one)?.querySelector('.save'))]);
    const figures = [...document.querySelectorAll('figure:has(svg, img, canvas)')].filter(ours).map(one => [
        one.querySelector('img') ? 'picture' : 'chart', one.querySelector('figcaption')?.textContent ?? 'no caption',
        offered(one.querySelector('.save'))]);
    const drawings = 'svg:not(.pen), canvas, img';
    const stray = [...document.querySelectorAll(drawings)].filter(one => ours(one) && !one.closest('figure, table'))
        .map(one => ['stray', one.outerHTML.slice(0, 80), '']);
    return [...tables, ...figures, ...stray];
}"""
FORMS = {
    "table": "CSV Markdown LaTeX",
    "chart": "SVG CSV",
    "picture": "PNG",
    "stray": "a figure or a table around it",
}


def saveable(view: Any) -> dict[str, int]:
    """How many of each kind the page shows; fails with the names of those that lack a form to be saved in."""
    found = view.evaluate(OFFERED)
    assert [(kind, name, forms) for kind, name, forms in found if forms != FORMS[kind]] == []
    return {kind: sum(one[0] == kind for one in found) for kind in FORMS}
