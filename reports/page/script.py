"""The script of a page: files of `scripts/` joined in one function, and the policy that allows only that text."""

import base64
import hashlib
from pathlib import Path

FILES = {file.name: file for file in (Path(__file__).parent / "scripts").glob("*/*.js")}


def script(*files: str) -> str:
    """Return the files in order, in one private scope that they share."""
    parts = [FILES[name].read_text(encoding="utf-8") for name in files]
    return '(() => {\n"use strict";\n' + "\n".join(parts) + "})();\n"


def content_policy(text: str, files: bool = False) -> str:
    """Return a Content-Security-Policy that forbids all requests and all scripts except `text`.

    `files` also allows script files from the origin of the page: its server, or the disk for a page opened from disk.
    No narrower rule works for both: Chromium matches a path, or a digest with an integrity attribute, for servers at
    most, and 'strict-dynamic' would allow files from anywhere.
    """
    digest = base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
    own = " 'self'" if files else ""
    return (
        f"default-src 'none'; script-src 'sha256-{digest}'{own}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
