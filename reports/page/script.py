"""The page's own script: files of `scripts/` one after another in one function, and the policy that allows that
text alone to run.
"""

import base64
import hashlib
from pathlib import Path

FILES = {file.name: file for file in (Path(__file__).parent / "scripts").glob("*/*.js")}


def script(*files: str) -> str:
    """Return the files in order, sharing one scope that nothing else can see."""
    parts = [FILES[name].read_text(encoding="utf-8") for name in files]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"


def content_policy(text: str = "", files: bool = False) -> str:
    """Return the page's Content-Security-Policy: nothing from anywhere, and no script but `text`, if there is one.

    `files` lets it load script files as well, from where the page itself is: its own server, or, for a page that was
    opened from a disk, that disk. Nothing narrower works for both: Chromium matches a path or a digest with an
    integrity attribute for neither or for servers alone, and 'strict-dynamic' would let files from anywhere in.
    """
    scripts = ""
    if text:
        digest = base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
        own = " 'self'" if files else ""
        scripts = f" script-src 'sha256-{digest}'{own};"
    return (
        f"default-src 'none';{scripts} style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
        "form-action 'none'"
    )
