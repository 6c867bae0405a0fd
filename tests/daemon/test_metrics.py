# SPDX-License-Identifier: MIT
"""`metrics`: OpenMetrics of a running canwired over HTTP. Its judges are the parsers of Prometheus'
own client, promtool and Prometheus. Bad clients come, too.

CANWIRE and CANWIRED are the programs.
"""

import json
import re
import resource
import socket
import subprocess
import time
import urllib.parse
import urllib.request
from pathlib import Path

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as open_parser
from prometheus_client.parser import text_string_to_metric_families as old_parser

from ports import free_port
from scrape import accepting, ask, connect, counters, parse, read_all
from simtool import CANWIRED, ROOT, answer, canwire, kill_all, listens, stop_canwired
from test_record import wait_until

PATIENCE_S = 120
OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
OLD = "text/plain; version=0.0.4; charset=utf-8"
WAITS = b"GET /metrics HTTP/1.1\r\nHost: a\r\n"  # without its end
CLIENTS_MAX = 16  # METRICS_CLIENTS_MAX

# All tables of counters: FD, buffers, sleep, ports, a tunnel, rules.
BUS = """bus: { name: day, bitrate: 500000, dbitrate: 2000000 }
control: day.sock
nodes:
  - { name: engine, traffic: [ { send: 123#DEADBEEF, every: 1ms, count: 100 } ] }
  - { name: dash, port: "unix:dash.sock", filter: [ "100:700" ] }
  - { name: fd, kind: fd, traffic: [ { send: 124##1DEADBEEF, every: 2ms, count: 20 } ] }
  - { name: far, port: "cannelloni:udp,listen=127.0.0.1:%d,peer=127.0.0.1:%d" }
faults:
  - { name: bad, when: { frame: "123", every: 10, count: 5 }, do: { flip: "crc[3]", at: dash } }
  - { name: asleep, when: { time: 1ms }, do: { set: [ fd ], sleep: on } }
record: [ { file: "odd \\"name\\".log" } ]
expect-report: verdict.xml
expect: [ { delivered: 100, frame: "123" } ]
"""
SMALL = "bus: { name: day, bitrate: 500000 }\ncontrol: day.sock\nnodes: [ { name: a } ]\n"


class Bus:
    """A canwired with metrics at a port, or where `metrics` says."""

    def __init__(self, folder, text, *words, metrics=None):
        self.folder, self.log, self.port = folder, folder / "log", free_port()
        self.at = ("127.0.0.1", self.port)
        self.text = text
        self.write(metrics or self.port)
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "day.yaml", *words], cwd=folder,
                                            stderr=log)
        wait_until(lambda: listens(folder / "day.sock"), "the socket")
        self.status()  # the loop answers, so all listens by now

    def write(self, metrics, text=None):
        (self.folder / "day.yaml").write_text((text or self.text) + f"metrics: {metrics}\n")

    def canwire(self, *words, status=0):
        return answer(self.folder, *words, status=status)

    def status(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def moved(self, address):
        wait_until(lambda: self.status()["metrics"]["address"] == address, address)

    def stop(self):
        return stop_canwired(self.process, self.log)


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    started = []

    def start(text=SMALL, *words, **more):
        started.append(Bus(tmp_path, text, *words, **more))
        return started[-1]

    yield start
    kill_all(each.process for each in started)


def families(text, parser=open_parser):
    return {one.name: one for one in parser(text)}


def samples(text):
    """The values by name and labels."""
    return {(s.name, tuple(sorted(s.labels.items()))): s.value
            for one in open_parser(text) for s in one.samples}


# ---- Numbers -------------------------------------------------------------------------------------

def whole_bus(bus):
    b = bus(BUS % (free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)), "--journal",
            "day.journal")
    wait_until(lambda: b.status()["nodes"][0]["tx_frames"] == 100, "its frames")
    return b


def values_of(part, counter):
    """The values of a counter in the status, by their words; {None: …} for a single one."""
    value = part[counter["name"]]
    return value if isinstance(value, dict) else {None: value}


def parts_of(status):
    """All in the status that has counters: table, labels, object."""
    bus = {"bus": status["bus"]["name"]}
    yield "bus", bus, status["bus"]
    for node in status["nodes"]:
        labels = bus | {"node": node["name"]}
        yield from ((table, labels, node) for table in ("node", "host", "sleep"))
        yield from ((table, labels, node[table]) for table in ("interface", "tunnel")
                    if node.get(table))


def test_every_counter_of_the_tables_is_there_with_the_value_of_the_status(bus):
    """The bus rests when its traffic is over: only what time moves lies between two statuses."""
    b = whole_bus(bus)
    before, answered, after = b.status(), ask(b.at), b.status()
    known, seen = samples(answered.body), set()
    for (table, labels, one), (_, _, other) in zip(parts_of(before), parts_of(after)):
        for of, counter, name, digits in counters():
            if of != table or counter["name"] not in one:
                continue
            for word, low in values_of(one, counter).items():
                extra = {"reason" if "dropped" in counter["name"] else "type": word} if word else {}
                found = [known[name + end, tuple(sorted((labels | extra).items()))]
                         for end in ("", "_total")
                         if (name + end, tuple(sorted((labels | extra).items()))) in known]
                assert len(found) == 1, (name, labels, extra)
                high = values_of(other, counter)[word]
                assert min(low, high) <= round(found[0] * 10 ** digits) <= max(low, high), name
                seen.add((table, counter["name"]))
    assert seen == {(table, counter["name"]) for table, counter, _, _ in counters()}
    b.stop()


def test_the_parsers_and_promtool_take_each_line(bus):
    b = whole_bus(bus)
    new, old = ask(b.at), ask(b.at, accepting("text/plain"))
    assert (new.head["content-type"], old.head["content-type"]) == (OPENMETRICS, OLD)
    assert new.body.endswith("\n# EOF\n") and "# EOF" not in old.body
    found = families(new.body)
    assert found.keys() == families(old.body, old_parser).keys()
    assert all(one.documentation for one in found.values())
    assert found["canwire_node_tx_frames"].type == "counter"
    assert found["canwire_node_queue_frames"].type == "gauge"
    assert found["canwire_bus_load_ratio"].unit == "ratio"
    checked = subprocess.run(["promtool", "check", "metrics"], input=old.body, text=True,
                             capture_output=True, timeout=PATIENCE_S, check=False)
    assert (checked.returncode, checked.stdout, checked.stderr) == (0, "", "")
    b.stop()


def test_states_rules_and_sinks_have_labels(bus):
    b = whole_bus(bus)
    known = samples(ask(b.at).body)

    def value(metric, **labels):
        return known[metric, tuple(sorted(labels.items()))]

    status = b.status()
    assert value("canwire_node_state", bus="day", node="engine", state="error-active") == 1
    assert value("canwire_node_state", bus="day", node="engine", state="bus-off") == 0
    assert value("canwire_rule_hits_total", bus="day", rule="bad") == 5
    assert value("canwire_node_rx_errors_total", bus="day", node="dash") == \
        status["nodes"][1]["rx_errors"] > 0
    assert value("canwire_node_rec", bus="day", node="dash") == status["nodes"][1]["rec"]
    assert value("canwire_sink_good", bus="day", kind="record",
                 name='odd "name".log') == 1
    for name, kind, state in (('odd "name".log', "record", "recording"),
                              ("verdict.xml", "expect-report", "judging")):
        assert value("canwire_sink_state", bus="day", kind=kind, name=name, state=state) == 1
    assert value("canwire_sink_lost_total", bus="day", kind="journal", name="day.journal") == 0
    wait_until(lambda: any(key == "canwire_sink_bytes_total" and count > 0 and
                           ("kind", "journal") in labels
                           for (key, labels), count in samples(ask(b.at).body).items()), "bytes")
    assert not re.search(r"^# HELP \S+ (\S+) \1 ", ask(b.at).body, re.MULTILINE)
    assert value("canwire_expectations_judged", bus="day") == 1
    assert value("canwire_expectations_failed", bus="day") == 0
    b.stop()


def test_without_a_control_socket_the_errors_are_counted_too(tmp_path):
    """Each of the five bad frames is a CRC error for dash, and a form error for its transmitter."""
    port = free_port()
    text = BUS[BUS.index("nodes:"):BUS.index("  - { name: dash")] + "  - { name: dash }\n" + \
        BUS[BUS.index("faults:"):BUS.index("  - { name: asleep")]
    (tmp_path / "day.yaml").write_text(
        "bus: { name: day, bitrate: 500000 }\n" + text + f"metrics: {port}\n")

    def errors():
        try:
            known = samples(ask(("127.0.0.1", port)).body)
        except ConnectionRefusedError:
            return None  # it does not listen yet
        return [known[f"canwire_node_{way}_errors_total", (("bus", "day"), ("node", node))]
                for way, node in (("rx", "dash"), ("tx", "engine"), ("tx", "dash"))]

    log = tmp_path / "log"
    with log.open("w") as out:
        process = subprocess.Popen([CANWIRED, "-c", "day.yaml"], cwd=tmp_path, stderr=out)
    try:
        wait_until(lambda: errors() == [5, 5, 0], "the errors")
        stop_canwired(process, log)
    finally:
        kill_all([process])


def test_the_dashboard_asks_for_metrics_that_exist(bus):
    """Also each label that it asks for, and by which it sums."""
    b = whole_bus(bus)
    known = {}
    for one in open_parser(ask(b.at).body):
        for sample in one.samples:
            known.setdefault(sample.name, set()).update(sample.labels)
    dashboard = json.loads((ROOT / "config/metrics/grafana.json").read_text())
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    queries += [variable["query"]["query"] for variable in dashboard["templating"]["list"]
                if variable["type"] == "query"]
    assert len(queries) > 12
    for query in queries:
        named = re.findall(r"(canwire_\w+)(?:\{([^}]*)\})?", query)
        assert named, query
        for name, wanted in named:
            assert name in known, query
            assert set(re.findall(r"(\w+)[=!]", wanted)) <= known[name], query
    b.stop()


# ---- Prometheus ----------------------------------------------------------------------------------

def test_prometheus_scrapes_a_bus_that_runs(bus, tmp_path):
    b = bus(SMALL.replace("{ name: a }", '{ name: a, traffic: [ { send: 001#, every: 10ms } ] }, '
                          "{ name: b }"))
    text = (ROOT / "config/metrics/prometheus.yml").read_text()
    assert "127.0.0.1:9464" in text and "scrape_interval: 5s" in text
    file, port = tmp_path / "prometheus.yml", free_port()
    file.write_text(text.replace("9464", str(b.port)).replace("5s", "200ms"))
    subprocess.run(["promtool", "check", "config", file], check=True, capture_output=True,
                   timeout=PATIENCE_S)
    with (tmp_path / "prometheus.log").open("w") as log:
        process = subprocess.Popen(
            ["prometheus", f"--config.file={file}", f"--storage.tsdb.path={tmp_path}/data",
             f"--web.listen-address=127.0.0.1:{port}"], stderr=log)
    try:
        def query(text):
            asked = f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode(
                {"query": text})
            try:
                with urllib.request.urlopen(asked, timeout=PATIENCE_S) as page:
                    return [float(one["value"][1]) for one in json.load(page)["data"]["result"]]
            except OSError:
                return []  # it does not answer yet

        def found(text):
            wait_until(lambda: query(text) not in ([], [0.0]), text)
            return query(text)

        assert found('up{job="canwire"}') == [1]
        assert found('canwire_node_tx_frames_total{bus="day",node="a"} > 50')[0] > 50
        assert found('rate(canwire_bus_frames_total{bus="day"}[1m])')[0] > 0
        assert found('canwire_node_state{node="b",state="error-active"}') == [1]
    finally:
        process.terminate()
        process.wait(PATIENCE_S)
    b.stop()


# ---- HTTP ----------------------------------------------------------------------------------------

@pytest.mark.parametrize("accept, kind", [
    ("*/*", OPENMETRICS), ("text/html, */*;q=0.8", OPENMETRICS),
    ("application/openmetrics-text;version=1.0.0,application/openmetrics-text;version=0.0.1;q=0.75,"
     "text/plain;version=0.0.4;q=0.5,*/*;q=0.1", OPENMETRICS),
    ("text/plain", OLD), ("text/plain;version=0.0.4;q=0.5, */*;q=0.1", OLD),
    ("application/openmetrics-text; version=2.0.0, text/plain", OLD),
    ("application/openmetrics-text;q=0, text/*", OLD),
    ("APPLICATION/OPENMETRICS-TEXT", OPENMETRICS),
    ("", OPENMETRICS), (";;,,;q=x,text", OPENMETRICS)])
def test_a_program_says_what_it_takes(bus, accept, kind):
    b = bus()
    assert ask(b.at, accepting(accept)).head["content-type"] == kind
    b.stop()


def test_wrong_requests_get_the_error_that_is_theirs(bus):
    b = bus()
    wrong = {
        b"POST /metrics HTTP/1.1\r\nContent-Length: 3\r\n\r\nabc": 405,
        b"DELETE /metrics HTTP/1.1\r\n\r\n": 405,
        b"GET / HTTP/1.1\r\n\r\n": 404,
        b"GET /metricsx HTTP/1.1\r\n\r\n": 404,
        b"GET /../etc/passwd HTTP/1.1\r\n\r\n": 404,
        b"GET /metrics HTTP/2.0\r\n\r\n": 505,
        b"GET /metrics\r\n\r\n": 400,
        b"\r\n\r\n": 400,
        b"\0\0\0\0\n\n": 400,
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n": 505,
        b"GET /metrics HTTP/1.1\r\nX: " + b"x" * 9000 + b"\r\n\r\n": 431,
        b"x" * 300000: 431,
    }
    for request, status in wrong.items():
        answered = ask(b.at, request)
        assert answered.status == status, request[:40]
        assert len(answered.body) == int(answered.head["content-length"])
    head = ask(b.at, b"HEAD /metrics?x=1 HTTP/1.0\n\n")
    assert (head.status, head.body) == (200, "") and int(head.head["content-length"]) > 1000
    known = b.status()["metrics"]
    assert (known["requests"], known["refused"]) == (1, len(wrong))
    b.stop()


def test_one_request_a_connection_is_answered_however_many_it_sends(bus):
    b = bus()
    answered = ask(b.at, (WAITS + b"\r\n") * 20)
    assert answered.status == 200 and answered.body.count("# EOF") == 1
    assert b.status()["metrics"]["requests"] == 1
    with connect(b.at) as end:  # byte by byte
        for byte in WAITS + b"\r\n":
            end.sendall(bytes([byte]))
        assert parse(read_all(end)).status == 200
    b.stop()


def test_connections_that_say_nothing_do_not_keep_others_out(bus):
    """One more than there are places ends the oldest one each time."""
    b = bus()
    quiet = [connect(b.at) for _ in range(3 * CLIENTS_MAX)]
    assert ask(b.at).status == 200
    known = b.status()["metrics"]
    assert known["dropped"] >= 2 * CLIENTS_MAX and known["clients"] <= CLIENTS_MAX
    assert [end.recv(1) for end in quiet[:CLIENTS_MAX]] == [b""] * CLIENTS_MAX
    for end in quiet:
        end.close()
    b.stop()


def test_slow_requests_and_slow_readers_are_dropped_and_counted(bus):
    """The reader takes none of a page that is larger than what the kernel keeps."""
    nodes = ", ".join(f"{{ name: n{i} }}" for i in range(64))
    b = bus(SMALL.replace("{ name: a }", nodes))
    slow, reader = connect(b.at), socket.socket()
    reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    reader.settimeout(PATIENCE_S)
    reader.connect(b.at)
    slow.sendall(WAITS)
    reader.sendall(WAITS + b"\r\n")
    for _ in range(5):
        assert ask(b.at).status == 200
    wait_until(lambda: b.status()["metrics"]["clients"] == 0, "the end of slow ones")
    assert b.status()["metrics"]["dropped"] == 2
    assert slow.recv(1) == b""  # whole: its end
    slow.close()
    reader.close()
    assert ask(b.at).status == 200
    b.stop()


def test_a_lack_of_descriptors_is_told_once_and_its_end(bus):
    """However long it lasts. A round in which canwired tried only once has to last longer."""
    b, rounds, pauses, patience_s = bus(), 0, 0, 3
    soft, hard = resource.prlimit(b.process.pid, resource.RLIMIT_NOFILE)
    while pauses < 2:
        rounds += 1
        used = {int(one.name) for one in Path(f"/proc/{b.process.pid}/fd").iterdir()}
        free = min(set(range(len(used) + 1)) - used)
        resource.prlimit(b.process.pid, resource.RLIMIT_NOFILE, (free, hard))
        with connect(b.at) as end:
            end.sendall(WAITS + b"\r\n")
            wait_until(lambda: b.log.read_text().count("Too many open files") == rounds, "the lack")
            time.sleep(patience_s)  # no wait: canwired tries again, and says nothing
            resource.prlimit(b.process.pid, resource.RLIMIT_NOFILE, (soft, hard))
            assert parse(read_all(end)).status == 200
        wait_until(lambda: b.log.read_text().count("accepted again") == rounds, "its end")
        pauses = int(re.findall(r"metrics: connections are accepted again, after (\d+) pause",
                                b.log.read_text())[-1])
        patience_s *= 2
    told = f"metrics 127.0.0.1:{b.port}: no connection can be accepted: Too many open files"
    assert b.stop().count(told) == rounds


def test_a_reader_that_goes_away_does_no_harm(bus):
    b = bus()
    for _ in range(50):
        with connect(b.at) as end:
            end.sendall(WAITS + b"\r\n")
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    assert ask(b.at).status == 200
    b.stop()


# ---- Places --------------------------------------------------------------------------------------

def test_a_socket_with_a_path_serves_too(bus):
    b = bus(metrics="unix:m.sock")
    assert families(ask(b.folder / "m.sock").body)["canwire_bus_frames"]
    assert b.status()["metrics"]["address"] == "unix:m.sock"
    line = "metrics unix:m.sock: requests 1 refused 0 dropped 0\n"
    assert line in b.canwire("status", "./day.sock")
    b.stop()
    assert not (b.folder / "m.sock").exists()


def test_without_the_key_nothing_listens(bus):
    b = bus(metrics="unix:m.sock")
    b.write("unix:m.sock", text=SMALL)
    (b.folder / "day.yaml").write_text(SMALL)
    b.canwire("reload", "./day.sock")
    wait_until(lambda: b.status()["metrics"] is None, "the reload")
    assert not (b.folder / "m.sock").exists()
    assert "metrics" not in b.canwire("status", "./day.sock")
    b.stop()


def test_a_reload_moves_the_socket_and_keeps_one_that_stays(bus):
    b = bus()
    old, other = b.at, free_port()
    with connect(old) as before:
        before.sendall(WAITS)
        b.canwire("reload", "./day.sock")  # nothing has changed
        assert ask(old).status == 200
        b.write(f"localhost:{other}")
        b.canwire("reload", "./day.sock")
        assert ask(("127.0.0.1", other)).status == 200
        with pytest.raises(ConnectionRefusedError):
            connect(old)
        before.sendall(b"\r\n")  # one that was there goes on
        assert parse(read_all(before)).status == 200
    b.write(b.port)
    b.canwire("reload", "./day.sock")
    assert ask(old).status == 200
    b.stop()


def test_start_and_reload_judge_a_taken_address_alike(bus):
    with socket.socket() as other:
        other.bind(("127.0.0.1", free_port()))
        other.listen()
        taken = "127.0.0.1:%d" % other.getsockname()[1]
        b = bus()
        b.write(taken)
        problem = f"day.yaml:4:10: metrics {taken}: Address already in use"
        assert problem in b.canwire("reload", "./day.sock", status=1)
        assert ask(b.at).status == 200
        assert b.status()["metrics"]["address"] == f"127.0.0.1:{b.port}"
        b.canwire("reload", "./day.sock", status=1)
        b.stop()
        started = subprocess.run([CANWIRED, "-c", "day.yaml"], cwd=b.folder, text=True,
                                 capture_output=True, timeout=PATIENCE_S, check=False)
        assert started.returncode == 1 and problem in started.stderr


def test_a_reload_moves_to_an_address_that_overlaps_its_own(bus):
    """To all addresses of the machine and back, with IPv4 and IPv6. At each of them it takes
    connections, and nobody else can listen there."""
    b = bus()
    for host, family, alone in (("0.0.0.0", socket.AF_INET, "127.0.0.1"),
                                ("127.0.0.1", socket.AF_INET, "127.0.0.1"),
                                ("[::1]", socket.AF_INET6, "::1"),
                                ("[::]", socket.AF_INET6, "::1"),
                                ("[::1]", socket.AF_INET6, "::1")):
        b.write(f"'{host}:{b.port}'")
        b.canwire("reload", "./day.sock")
        b.moved(f"{host}:{b.port}")
        assert ask((alone, b.port)).status == 200
        with socket.socket(family) as other:
            other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with pytest.raises(OSError, match="Address already in use"):
                other.bind((alone, b.port))
                other.listen()
    with pytest.raises(ConnectionRefusedError):
        connect(b.at)
    assert "metrics" not in b.stop()


def test_a_reload_to_an_overlapping_address_that_is_taken_changes_nothing(bus):
    """Another program has a further address of the same port."""
    b = bus()
    with socket.socket() as other:
        other.bind(("127.0.0.2", b.port))
        other.listen()
        b.write(f"0.0.0.0:{b.port}")
        problem = f"day.yaml:4:10: metrics 0.0.0.0:{b.port}: Address already in use"
        for _ in range(2):
            assert problem in b.canwire("reload", "./day.sock", status=1)
            assert ask(b.at).status == 200
            assert b.status()["metrics"]["address"] == f"127.0.0.1:{b.port}"
    b.canwire("reload", "./day.sock")
    b.moved(f"0.0.0.0:{b.port}")
    assert ask(("127.0.0.2", b.port)).status == 200
    b.stop()


def test_a_reload_that_is_refused_for_something_else_listens_where_it_did(bus):
    """The bus keeps its name; it refuses another one when the new address has been opened."""
    b = bus()
    for _ in range(2):
        b.write(f"0.0.0.0:{b.port}", text=b.text.replace("day,", "night,"))
        b.canwire("reload", "./day.sock", status=1)
        assert ask(b.at).status == 200
        with pytest.raises(ConnectionRefusedError):
            connect(("127.0.0.2", b.port))
    b.write(f"0.0.0.0:{b.port}")
    b.canwire("reload", "./day.sock")
    b.moved(f"0.0.0.0:{b.port}")
    assert ask(("127.0.0.2", b.port)).status == 200
    b.stop()


def test_a_reload_takes_another_spelling_of_the_same_path(bus):
    b = bus(metrics="unix:m.sock")
    (b.folder / "dir").mkdir()
    for path in "dir/../m.sock", str(b.folder / "m.sock"), "m.sock":
        b.write(f"unix:{path}")
        b.canwire("reload", "./day.sock")
        b.moved(f"unix:{path}")
        assert ask(b.folder / "m.sock").status == 200
    b.write("unix:dir/m.sock")  # the same name elsewhere
    b.canwire("reload", "./day.sock")
    assert ask(b.folder / "dir/m.sock").status == 200
    assert not (b.folder / "m.sock").exists()
    b.stop()
    assert not list(b.folder.glob("**/m.sock*"))


def test_a_rig_has_one_page_of_all_its_buses(tmp_path):
    port = free_port()
    for name, more in ("body", f"metrics: {port}\n"), ("safety", ""):
        (tmp_path / f"{name}.yaml").write_text(
            f"bus: {{ bitrate: 500000, name: {name} }}\ncontrol: {name}.sock\nnodes:\n"
            "  - { name: gate }\n  - { name: a, traffic: [ { send: 123#11, every: 1ms, count: 9 } ]"
            " }\n" + more)
    (tmp_path / "rig.yaml").write_text(
        "buses: [body.yaml, safety.yaml]\ngateways:\n  - name: link\n"
        "    between: [ 'body:gate', 'safety:gate' ]\n    rules: [ { filter: '123' } ]\n")
    log = tmp_path / "log"
    with log.open("w") as out:
        process = subprocess.Popen([CANWIRED, "-c", "rig.yaml"], cwd=tmp_path, stderr=out)
    try:
        wait_until(lambda: listens(tmp_path / "body.sock"), "the rig")
        answer(tmp_path, "status", "./body.sock")  # the loop answers, so all listens by now

        def value(name, **labels):
            return samples(ask(("127.0.0.1", port)).body)[name, tuple(sorted(labels.items()))]

        for bus in "body", "safety":
            wait_until(lambda: value("canwire_bus_frames_total", bus=bus) == 18, bus)
        for direction in "forward", "backward":
            assert value("canwire_gateway_forwarded_frames_total", gateway="link",
                         direction=direction) == 9
        stop_canwired(process, log)
    finally:
        kill_all([process])


def test_two_buses_of_a_rig_cannot_have_the_same_place(tmp_path):
    for name in "one", "two":
        (tmp_path / f"{name}.yaml").write_text(
            f"bus: {{ bitrate: 500000, name: {name} }}\nnodes: [ {{ name: a }} ]\nmetrics: 9464\n")
    (tmp_path / "rig.yaml").write_text("buses: [one.yaml, two.yaml]\n")
    said = canwire("check", "rig.yaml", cwd=tmp_path, status=1).stderr
    assert "rig.yaml:1:19: buses: duplicate metrics '127.0.0.1:9464', in one.yaml and in two.yaml" \
        in said
