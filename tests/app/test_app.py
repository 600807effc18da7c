"""The page's server: who may ask, how much, and that it answers as the command does."""

import asyncio
import json
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from command import EXAMPLE, WRONG, refused, tuned

pytest.importorskip("starlette", reason="needs starlette")
pytest.importorskip("httpx2", reason="needs httpx2")

from starlette.testclient import TestClient

from tuners.app.guard import LARGEST
from tuners.app.server import application
from tuners.tuner.rivals import GrayBox
from tuners.tuner.tuner import Tuner
from yawrate_env.plant import episodes
from yawrate_env.plants import sopdt

TOKEN = "a-token"
HOME = f"http://127.0.0.1:80/{TOKEN}/"


@pytest.fixture(scope="module")
def client():
    with TestClient(application(TOKEN), base_url=HOME) as opened:
        yield opened


def added(client, content, name="log.csv"):
    return client.post("logs", params={"name": name}, content=content).json()


@pytest.fixture(scope="module")
def log(client):
    return added(client, EXAMPLE.read_bytes())["number"]


@pytest.mark.parametrize(
    "path", ["", "a-toke", "a-token2/", "ä/", "logs", "app.js", "other/logs/1"]
)
def test_a_request_without_the_token_is_refused(client, path):
    for method in ("GET", "POST", "DELETE"):
        assert client.request(method, f"http://127.0.0.1:80/{path}").status_code == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_a_foreign_host_is_refused(client, host):
    assert client.get("", headers={"host": host}).status_code == 400


@pytest.mark.parametrize("origin", ["null", "http://evil.example", "http://127.0.0.1:81"])
def test_another_page_cannot_post(client, origin):
    sent = client.post("logs", content=b"t,u,y", headers={"origin": origin})
    assert sent.status_code == 403


def statuses(headers, receive, path="logs"):
    """Statuses that the server sends for one upload whose body `receive` brings."""
    scope = {
        "type": "http", "method": "POST", "path": f"/{TOKEN}/{path}", "query_string": b"",
        "headers": [(b"host", b"127.0.0.1"), *headers], "http_version": "1.1",
        "root_path": "", "scheme": "http", "server": ("127.0.0.1", 80), "client": None,
    }  # fmt: skip
    app, found = application(TOKEN), []

    async def send(message):
        if message["type"] == "http.response.start":
            found.append(message["status"])

    async def run():
        async with app.router.lifespan_context(app):
            await app(scope, receive, send)
            found.append(list(Path(app.state.uploads.folder).iterdir()))

    asyncio.run(run())
    return found


@pytest.mark.parametrize("path", ["logs", "logs/1", "logs/1/answer"])
@pytest.mark.parametrize("length", [b"200000000", b"100000001", b"-1", b"nan"])
def test_a_large_upload_is_refused_before_it_is_read(length, path):
    async def receive():
        raise AssertionError("it was read")

    assert statuses([(b"content-length", length)], receive, path) == [413, []]


def test_a_large_upload_without_a_length_is_refused_on_the_way():
    piece, sent = bytes(10_000_000), []

    async def receive():
        sent.append(len(piece))
        return {"type": "http.request", "body": piece, "more_body": True}

    assert statuses([], receive) == [413, []]
    assert sum(sent) == LARGEST + len(piece)


def test_an_upload_that_breaks_off_leaves_nothing():
    pieces = iter([{"type": "http.request", "body": b"t,u", "more_body": True}])

    async def receive():
        return next(pieces, {"type": "http.disconnect"})

    assert statuses([], receive) == [400, []]


def test_a_log_is_answered_as_by_the_command(client, log):
    told = client.post(f"logs/{log}/answer", json={}).json()
    assert told["answer"] == tuned(EXAMPLE, "ts-ff-lag-vx")
    assert told["exports"] == ["report", "json", "c", "matlab", "st"]
    kinds = {}
    for target in told["exports"]:
        sent = client.get(f"logs/{log}/files/{target}")
        assert sent.headers["content-disposition"].startswith("attachment")
        kinds[target] = sent.content
    assert json.loads(kinds["json"]) == told["answer"]
    assert kinds["c"].startswith(b"PK") and b"<title>" in kinds["report"]
    report = client.get(f"logs/{log}/report")
    assert report.content == kinds["report"]
    assert "sandbox allow-scripts;" in report.headers["content-security-policy"]
    assert "same-origin" not in report.headers["content-security-policy"]


@pytest.mark.parametrize(
    "form, flags",
    [
        ({"input-unit": "deg", "flip-output": True}, ["--input-unit", "deg", "--flip-output"]),
        ({"from": "4", "to": "12", "tuner": "bb"}, ["--from", "4", "--to", "12"]),
        (
            {"crossover": "2", "phase-margin": "55", "delay": "0.02"},
            ["--crossover", "2", "--phase-margin", "55", "--delay", "0.02"],
        ),
    ],
)
def test_a_form_acts_as_the_options(client, log, form, flags):
    told = client.post(f"logs/{log}/answer", json=form).json()
    assert told["answer"] == tuned(EXAMPLE, form.get("tuner", "ts-ff-lag-vx"), *flags)


@pytest.mark.parametrize(
    "form, flags",
    [
        ({"input-unit": "parsec"}, ["--input-unit", "parsec"]),
        ({"from": "9", "to": "3"}, ["--from", "9", "--to", "3"]),
        ({"input-column": "yaw_rate"}, ["--input-column", "yaw_rate"]),
        ({"Ts": "nan"}, ["--Ts", "nan"]),
        ({"from": "900"}, ["--from", "900"]),
        ({"delay": "0.015"}, ["--delay", "0.015"]),
        ({"crossover": "60"}, ["--crossover", "60"]),
    ],
)
def test_wrong_fields_get_the_commands_words(client, log, form, flags):
    line = refused(WRONG, "tune", EXAMPLE, *flags)
    for address in (f"logs/{log}", f"logs/{log}/answer"):
        told = client.post(address, json=form).json()
        assert f"error: {told['error']}\n" == line.replace(str(EXAMPLE), "log.csv")


@pytest.mark.parametrize("name, content", [
    ("empty.csv", b""),
    ("text.csv", b"nothing to see"),
    ("short.csv", b"t,steer,yaw_rate,speed\n0,0,0,20\n"),
    ("other.csv", b"a,b,c\n" + b"1,2,3\n" * 999),
    ("data.json", b'{"a": 1}'),
    ("broken.mat", b"MATLAB" + bytes(200)),
    ("packed.csv.gz", b"\x1f\x8b" + bytes(50)),
])  # fmt: skip
def test_a_bad_file_gets_the_commands_words(client, tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    told = added(client, content, name)
    assert f"error: {told['error']}\n" == refused(1, "tune", path).replace(str(path), name)


def test_columns_and_units_are_shown_as_understood(client):
    rows = "".join(f"{i / 50},{(-1) ** (i // 25)},{i % 50 / 50},72\n" for i in range(600))
    told = added(client, ("time [s],angle [deg],r,VehSpd [km/h]\n" + rows).encode())
    assert "error" in told and told["columns"] == ["time [s]", "angle [deg]", "r", "VehSpd [km/h]"]
    form = {"input-column": "angle [deg]", "output-column": "r", "output-unit": "deg/s"}
    told = client.post(f"logs/{told['number']}", json=form).json()
    assert "error" not in told, told
    roles = {role["role"]: (role["column"], role["unit"]) for role in told["roles"]}
    assert roles["time"] == ("time [s]", "s")
    assert roles["input"] == ("angle [deg]", "deg")
    assert roles["output"] == ("r", "deg/s")
    assert roles["speed"] == ("VehSpd [km/h]", "km/h")
    assert told["stretch"] == [0.0, 11.98]
    assert told["loop"] == {"crossover": 1.5, "phase-margin": 60.0, "delay": 0.0}


@pytest.mark.parametrize(
    "form", [{"dbc": "/etc/passwd"}, {"tuner": "/etc/x.tuner"}, {"help": ""}, {"Ts": 3}, {"to": []}]
)
def test_a_form_reaches_no_other_option_and_no_file(client, log, form):
    assert "error" in client.post(f"logs/{log}", json=form).json()


@pytest.mark.parametrize("name", ["../../x.csv", "/etc/passwd", "a\\b.csv", "\0\n", "", "x" * 999])
def test_a_files_name_leads_nowhere(client, name):
    folder = client.app.state.uploads.folder
    number = added(client, b"t,u", name)["number"]
    inside = [path.relative_to(folder) for path in folder.rglob("*") if path.is_file()]
    assert any(path.parts[0] == str(number) and path.stem == "log" for path in inside)
    assert client.delete(f"logs/{number}").status_code == 204
    assert not (folder / str(number)).exists()
    assert client.get(f"logs/{number}/report").status_code == 404


def test_a_long_log_is_thinned_and_keeps_its_peaks():
    import numpy as np

    from tuners.app.answers import thinned

    t = np.arange(100_000.0)
    x = np.sin(t / 900)
    x[54_321] = 7.0
    times, values = thinned(t, x, 1000)
    assert len(times) == len(values) == 2000 and values.max() == 7.0
    assert (np.diff(times) > 0).all() and abs(times[values.argmax()] - 54_321) <= 100


def test_a_defect_is_told_as_one(monkeypatch):
    from tuners.app import answers

    def broken():
        raise RuntimeError

    monkeypatch.setattr(answers, "choices", broken)
    with TestClient(application(TOKEN), HOME, raise_server_exceptions=False) as client:
        sent = client.get("choices")
        assert sent.status_code == 500 and list(sent.json()) == ["error"]


@pytest.fixture
def running(tmp_path):
    """The command as a process: its address, itself, and where it keeps files."""
    program = [sys.executable, "-m", "tuners.cli", "app", "--no-browser"]
    env = {"TMPDIR": str(tmp_path), "PATH": "", "PYTHONPATH": ":".join(filter(None, sys.path))}
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, env=env) as process:
        yield process.stdout.readline().strip(), process, tmp_path
        process.kill()


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_files_are_gone_when_it_ends(running, sent):
    address, process, folder = running
    log = urllib.request.Request(f"{address}logs?name=a.csv", b"t,u,y\n", method="POST")
    assert json.load(urllib.request.urlopen(log))["number"] == 1
    assert len(list(folder.rglob("log.csv"))) == 1
    process.send_signal(sent)
    assert process.wait(20) == (0 if sent == signal.SIGINT else -sent)
    assert list(folder.iterdir()) == []


def test_it_listens_on_this_machine_alone(running):
    address, _, _ = running
    port = int(address.split(":")[2].split("/")[0])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as route:
        try:
            route.connect(("192.0.2.1", 9))  # nothing is sent: it finds this machine's address
        except OSError:
            pytest.skip("this machine has no other address")
        outside = route.getsockname()[0]
    with pytest.raises(OSError):
        socket.create_connection((outside, port), timeout=1)
    socket.create_connection(("127.0.0.1", port), timeout=1).close()


def test_a_tuner_of_ones_own_is_the_default_and_offers_its_controllers(tmp_path):
    plant = sopdt(controller="PIDF", experiment={"N": 300, "signals": ["heater [%]", "level [m]"]})
    path = tmp_path / "heater.tuner"
    Tuner(plant, GrayBox(), {"name": "gray-box"}).save(path)
    y = episodes.recorded(plant, "test", 0, 1).y[0]
    time = np.arange(len(y)) * plant.Ts
    rows = np.column_stack([time, plant.u, y])
    lines = (",".join(map(repr, row)) for row in rows.tolist())
    text = "\n".join(["time [s],heater [%],level [m]", *lines])
    with TestClient(application(TOKEN, (str(path),)), base_url=HOME) as opened:
        offered = opened.get("choices").json()
        assert offered["default"] == offered["tuners"][0] == str(path)
        told = added(opened, text.encode())
        assert "error" not in told and "heater.tuner" in told["command"] and told["loop"] == {}
        found = opened.post(f"logs/{told['number']}/answer", json={}).json()
        assert set(found["answer"]["gains"]) == {"kp", "Ti", "Td", "Tf"}
        assert found["exports"] == ["report", "json"]  # its limits are not known
        report = opened.get(f"logs/{told['number']}/report").text
        assert "<option>2DOF</option>" in report and "Time constant of the loop" in report
