"""Pages in a headless Chromium: the page is loaded, a script runs in it, and what it returns comes back."""

import json
import os
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path
from typing import Any

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
WHY = "no Chromium here: apt-get install chromium brings one"
AXE = os.environ.get("RPAUG_AXE", "")
WHY_NO_AXE = "RPAUG_AXE names no axe.min.js: npm pack axe-core brings it"

FINDINGS = """const found=await axe.run();
const bad=found.violations.filter((v)=>['serious','critical'].includes(v.impact));
return bad.map((v)=>v.id+': '+v.nodes[0].html)"""


def run(page: bytes, script: str, folder: Path, width: int = 1400, height: int = 1000) -> Any:
    """What the body of an async function returns in the page, as plain values."""
    path = folder / "page.html"
    path.write_bytes(page + asking(script))
    return visit(path.as_uri(), folder, width, height)


def asking(script: str) -> bytes:
    """What a page ends with for `visit` to find what the body of an async function returns in it."""
    end = (
        "<script>window.faults=[];addEventListener('error',(e)=>faults.push(e.message));"
        "addEventListener('unhandledrejection',(e)=>faults.push(String(e.reason)));"
        f"(async()=>{{let out;try{{out=await (async()=>{{{script}}})()}}catch(e){{out='threw: '+e.stack}}"
        "const pre=document.createElement('pre');pre.id='came-to';"
        "pre.textContent=JSON.stringify({out,faults});document.documentElement.append(pre)})()</script>"
    )
    return end.encode()


def visit(url: str, folder: Path, width: int = 1400, height: int = 1000) -> Any:
    """What the script of a page with such an end returned; the profile goes into `folder`."""
    assert CHROMIUM is not None
    command = [
        CHROMIUM, "--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=400000",
        f"--user-data-dir={folder / 'profile'}", f"--window-size={width},{height}", "--dump-dom", url,
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    found = re.search(r'<pre id="came-to">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    came_to = json.loads(unescape(found[1]))
    assert came_to["faults"] == []
    return came_to["out"]
