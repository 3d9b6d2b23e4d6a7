"""The texts of each shelf of studies, the groups of its checks, and its chapters."""

from dataclasses import dataclass, field

from harness.records.study import CHAPTERS, SHELVES, Owner


@dataclass(frozen=True)
class ShelfWords:
    """The texts of one shelf. Nouns and verbs are pairs of singular and plural."""

    title: str
    link: str
    noun: tuple[str, str]
    check: tuple[str, str]
    passes: tuple[str, str] = ("holds", "hold")
    nothing: str = ""
    """The headline if there is no such check, instead of the title."""
    owner: Owner = "ours"
    outcomes: str = "Properties found"
    """The title of the section with the machine's targets and the failures of the paper's and the usual forms."""
    groups: dict[str, str] = field(default_factory=dict)
    """The first letter of a study's id → the title of its part of the matrix; empty if there is no matrix."""
    chapters: dict[int, str] = field(default_factory=dict)
    """`item` of lines, tables and pictures → the title of the section that collects them from all studies."""
    folded: bool = False


WORDS = {
    "evidence": ShelfWords(
        title="Evidence",
        link="only the evidence",
        noun=("study", "studies"),
        check=("check of the evidence", "checks of the evidence"),
        nothing="Evidence without a check",
    ),
    "stability": ShelfWords(
        title="Numerical stability",
        link="only numerical stability",
        noun=("case", "cases"),
        check=("stability check of this harness", "stability checks of this harness"),
        passes=("passes", "pass"),
        nothing="Numerical stability: nothing of this harness was tried",
        groups={
            "Q": "Quadrature and sampling",
            "E": "Encodings",
            "A": "The amplifier",
            "O": "Optimiser and half precision",
            "G": "Gaussians and grids",
            "S": "Stiff and extreme scenes",
            "C": "Cameras and sizes",
            "R": "An independent reference",
            "L": "Ladders",
            "N": "What a scene does not need",
        },
        chapters=CHAPTERS,
        folded=True,
    ),
    "speed": ShelfWords(
        title="Speed",
        link="speed of this machine",
        noun=("question", "questions"),
        check=("speed target", "speed targets"),
        passes=("is met", "are met"),
        nothing="Speed of training and rendering",
        owner="machine",
        outcomes="Targets",
    ),
    "serving": ShelfWords(
        title="View cache and attention (§8)",
        link="only view cache and attention",
        noun=("study", "studies"),
        check=("target of serving", "targets of serving"),
        passes=("is met", "are met"),
        nothing="View cache and attention",
        owner="machine",
        outcomes="Targets, and what the paper's forms fail",
        folded=True,
    ),
    "frontier": ShelfWords(
        title="The frontier: error against core seconds",
        link="the frontier of families",
        noun=("question", "questions"),
        check=("check of the frontier", "checks of the frontier"),
    ),
    "history": ShelfWords(
        title="History of gates and speed",
        link="history of gates and speed",
        noun=("machine", "machines"),
        check=("figure", "figures"),
    ),
}


def page_of(shelf: str) -> str:
    return SHELVES[shelf].replace(".json", ".html")
