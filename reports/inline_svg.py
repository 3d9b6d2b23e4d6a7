"""A drawing of Matplotlib → one element of a page: text stays text, colours become CSS variables, ids are unique."""

import re

from markupsafe import escape

from reports import palette


def inlined(text: str, name: str, alt: str) -> str:
    """A standalone SVG of Matplotlib made fit for one page among many others."""
    body = text[text.index("<svg") :]
    box = re.search(r'viewBox="([^"]+)"', body)
    inner = body[body.index(">") + 1 : body.rindex("</svg>")]
    inner = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", inner, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', inner))
    inner = re.sub(r' id="([^"]+)"', lambda found: f' id="{name}-{found[1]}"' if found[1] in used else "", inner)
    inner = re.sub(r'(xlink:href="#|url\(#)', lambda found: f"{found[1].removeprefix('xlink:')}{name}-", inner)
    inner = re.sub(r"font-family: [^;\"]+;? ?", "", inner)
    inner = re.sub(r" transform=\"rotate\(-0 [^\"]+\"", "", inner)
    inner = re.sub(r'="[^"]*"', lambda found: re.sub(r"(\d\.\d\d)\d+", r"\1", found[0]), inner)
    inner = re.sub(r"\s*\n\s*", " ", inner)
    for colour in palette.EVERY:
        inner = inner.replace(colour.light, f"var({colour.variable})")
    view = box[1] if box else "0 0 1 1"
    return f'<svg class="plot" viewBox="{view}" role="img" aria-label="{escape(alt)}">{inner}</svg>'
