"""The public recordings: what is fetched, from where, checked how; and the flights written from it."""

from __future__ import annotations

import hashlib
import http.server
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from skytrace.datasets import DATASETS, download, fetch_datasets, find_dataset, write_dataset
from skytrace.datasets.download import RemoteFile, needed_files, registry
from skytrace.errors import InputError
from skytrace.io.flight import read_flight

CALIBRATION = (
    '{"K-matrix": [[1500, 0, 960], [0, 1500, 540], [0, 0, 1]], "distCoeff": [0, 0, 0, 0], "fps": 30, '
    '"resolution": [1920, 1080]}'
)
CONTENT = {
    "detections_auto": "525 313 923\n526 311 924\n",
    "detections_manual": "923 525.0 313.0\n924 526.0 311.0\n",
    "calibration": CALIBRATION,
    "truth": "1.0 2.0 3.0\n1.1 2.1 3.1\n",
    "camera_positions": "1 2 3\n" * 6,
    "licence": "the licence\n",
}


@dataclass
class Server:
    """A repository on this machine, and what it was asked for."""

    url: str
    files: dict[str, bytes]
    asked: list[str]


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """Serves small stand-ins of all files, whose checksums take the place of the true ones."""
    pytest.importorskip("pooch")
    stand_ins = tuple(
        replace(f, sha256=hashlib.sha256(CONTENT[f.role].encode()).hexdigest()) if f.role in CONTENT else f
        for f in registry()
    )
    files = {f"/{f.commit}/{f.path}": CONTENT[f.role].encode() for f in stand_ins if f.role in CONTENT}
    asked: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = urlsplit(self.path).path
            asked.append(path)
            body = files.get(path)
            self.send_response(404 if body is None else 200)
            self.send_header("Content-Length", str(len(body or b"")))
            self.end_headers()
            self.wfile.write(body or b"")

        def log_message(self, format: str, *args: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        url = f"http://127.0.0.1:{running.server_address[1]}"
        monkeypatch.setattr(download, "BASE_URL", url)
        monkeypatch.setattr(download, "_RETRIES", 0)
        monkeypatch.setattr(download, "registry", lambda: stand_ins)
        monkeypatch.setenv("NO_PROXY", "127.0.0.1")
        try:
            yield Server(url, files, asked)
        finally:
            running.shutdown()
            thread.join()


def test_the_registry_knows_every_file_of_every_recording() -> None:
    local = [f.local for f in registry()]
    assert len(set(local)) == len(local)
    assert all(len(f.sha256) == 64 and len(f.commit) == 40 for f in registry())
    for name, dataset in DATASETS.items():
        for labels in ("auto", "manual"):
            needed = {f.local for f in needed_files(name, [labels])}
            assert {f"{name}/detections_{labels}/cam{k}.txt" for k in range(len(dataset.devices))} <= needed
            assert {f"calibration/{device}.json" for device in dataset.devices} <= needed
            assert {"LICENSE", f"{name}/trajectory/rtk.txt"} <= needed
            assert (f"{name}/camera-locations/campos.txt" in needed) == bool(dataset.surveyed)
            assert not any(f"detections_{'manual' if labels == 'auto' else 'auto'}" in path for path in needed)


def test_both_kinds_of_detections_come_from_one_path_at_two_commits() -> None:
    auto, manual = (
        [f for f in registry() if f.local == f"dataset3/detections_{k}/cam2.txt"] for k in ("auto", "manual")
    )
    assert auto[0].path == manual[0].path == "dataset3/detections/cam2.txt"
    assert auto[0].commit != manual[0].commit
    assert auto[0].sha256 != manual[0].sha256


def test_a_fetched_recording_becomes_a_flight(server: Server, tmp_path: Path) -> None:
    heard: list[tuple[str, int, int]] = []
    root = fetch_datasets(["dataset3"], ["auto"], tmp_path / "cache", lambda *step: heard.append(step))
    assert root == tmp_path / "cache"
    assert len(server.asked) == len(heard) == 15
    assert (root / "drone-tracking" / "LICENSE").read_text() == "the licence\n"
    assert heard[0] == ("LICENSE", 0, 15)
    flight = read_flight(write_dataset("dataset3", "auto", root, tmp_path / "flight"))
    assert [c.camera_id for c in flight.cameras] == [f"cam{k}" for k in range(6)]
    assert flight.truth is not None
    assert flight.truth.positions is not None

    # What is there is not fetched again; the other labels are all that is missing.
    server.asked.clear()
    fetch_datasets(["dataset3"], ["auto", "manual"], tmp_path / "cache")
    assert sorted(server.asked) == sorted(
        f"/{f.commit}/{f.path}" for f in registry() if f.local.startswith("dataset3/detections_manual")
    )
    assert len(server.asked) == 6


def test_a_spoilt_file_in_the_cache_is_fetched_again(server: Server, tmp_path: Path) -> None:
    root = fetch_datasets(["dataset1"], ["manual"], tmp_path)
    truth = root / "drone-tracking" / "dataset1" / "trajectory" / "rtk.txt"
    truth.write_text("9 9 9\n")
    server.asked.clear()
    fetch_datasets(["dataset1"], ["manual"], tmp_path)
    assert len(server.asked) == 1
    assert truth.read_text() == CONTENT["truth"]


def test_a_wrong_checksum_is_refused(server: Server, tmp_path: Path) -> None:
    path = next(p for p in server.files if p.endswith("dataset1/detections/cam2.txt"))
    server.files[path] = b"1 2 3\n"
    with pytest.raises(
        InputError, match=r"is not the file that was published: its SHA-256 is not [0-9a-f]{64}"
    ) as caught:
        fetch_datasets(["dataset1"], ["auto", "manual"], tmp_path)
    assert caught.value.path == server.url + path
    assert list(tmp_path.rglob("cam2.txt")) == []
    assert not [p for p in tmp_path.rglob("*") if p.is_file() and p.name.startswith("tmp")]


def test_a_missing_file_is_named(server: Server, tmp_path: Path) -> None:
    path = next(p for p in server.files if p.endswith("dataset4/trajectory/rtk.txt"))
    del server.files[path]
    with pytest.raises(InputError, match="the server says 404") as caught:
        fetch_datasets(["dataset4"], ["auto"], tmp_path)
    assert caught.value.path == server.url + path


def test_no_network_is_one_clear_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pooch")
    # Nothing listens on this port.
    monkeypatch.setattr(download, "BASE_URL", "http://127.0.0.1:9")
    monkeypatch.setattr(download, "_RETRIES", 0)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    with pytest.raises(InputError) as caught:
        fetch_datasets(["dataset1"], ["auto"], tmp_path)
    for words in ("is there a network?", "--cache FOLDER", "SKYTRACE_DATA", "github.com/CenekAlbl"):
        assert words in caught.value.message


def test_unknown_recordings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"did you mean 'dataset3'"):
        find_dataset("dataset33")
    with pytest.raises(InputError, match="no such labels"):
        write_dataset("dataset1", "best", tmp_path, tmp_path / "flight")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="the recording is not there: leave --data and SKYTRACE_DATA away"):
        write_dataset("dataset1", "auto", tmp_path, tmp_path / "flight")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.real
def test_the_local_copy_is_what_was_published(data_dir: Path) -> None:
    present = 0
    for file in registry():
        path = data_dir / "drone-tracking" / file.local
        if path.is_file():
            assert hashlib.sha256(path.read_bytes()).hexdigest() == file.sha256, file.local
            present += 1
    assert present >= 40


def test_files_know_their_place() -> None:
    file = RemoteFile("calibration/mate10/mate10_1.json", "c", "calibration", "s")
    assert file.local == "calibration/mate10_1.json"
    assert RemoteFile("dataset1/trajectory/rtk.txt", "c", "truth", "s").local == "dataset1/trajectory/rtk.txt"
