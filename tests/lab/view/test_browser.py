"""The pages in a real browser, headless; skipped where there is no Chromium."""

import re
import shutil
import subprocess

import pytest

from surefoot.lab.report.recorded import report_recording

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--virtual-time-budget=3000",
)  # fmt: skip

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")


@pytest.fixture
def seen(tmp_path):
    """Return the document of a page after its scripts have run, and the addresses that the browser asked for."""

    def look(url):
        log = tmp_path / "net.json"
        command = [
            CHROMIUM,
            *FLAGS,
            f"--user-data-dir={tmp_path / 'profile'}",
            f"--log-net-log={log}",
            "--dump-dom",
            url,
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
        return done.stdout, set(re.findall(r'"url":"(https?://[^"]*)"', log.read_text(errors="replace")))

    return look


def test_a_report_replays_and_asks_for_nothing(recorded, tmp_path, seen):
    path, _ = report_recording(recorded, None, tmp_path / "report.html")
    document, asked = seen(f"{path.as_uri()}#t=2.5")
    assert 'data-ready="1"' in document
    assert ">2.50 s<" in document
    assert document.count("<figcaption>") > 8
    assert not [url for url in asked if "127.0.0.1" not in url and "localhost" not in url]
