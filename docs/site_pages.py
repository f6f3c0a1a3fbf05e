"""What mkdocs needs beside docs/: README.md as first page, and what pages link to elsewhere.

Pages link as files of the repository do; here the links are turned into those of the site.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(\]\()(?!\w+:|#)([^)#\s]+)")


def on_files(files: Files, config: Any) -> Files:
    """Add README.md as index.md, and all files outside docs/ that it and the pages link to."""
    files.append(File.generated(config, "index.md", abs_src_path=str(ROOT / "README.md")))
    waiting = [file for file in files if file.is_documentation_page()]
    while waiting:
        page = waiting.pop()
        for _, link in _LINK.findall(page.content_string):
            target = _in_repository(page.src_uri, link)
            if target.startswith("docs/") or files.get_file_from_path(_on_site(target)):
                continue
            if (ROOT / target).is_file():
                file = File.generated(config, target, abs_src_path=str(ROOT / target))
                files.append(file)
                waiting += [file] if file.is_documentation_page() else []
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links between files of the repository into links between pages of the site."""
    here = posixpath.dirname(page.file.src_uri)

    def turned(match: re.Match[str]) -> str:
        target = _on_site(_in_repository(page.file.src_uri, match[2]))
        return match[1] + posixpath.relpath(target, here or ".")

    return _LINK.sub(turned, markdown)


def _in_repository(page: str, link: str) -> str:
    outside = page == "index.md" or not (ROOT / "docs" / page).exists()
    folder = posixpath.dirname(page if outside else f"docs/{page}")
    return posixpath.normpath(posixpath.join(folder, link))


def _on_site(target: str) -> str:
    return "index.md" if target == "README.md" else target.removeprefix("docs/")
