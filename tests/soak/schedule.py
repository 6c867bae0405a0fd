# SPDX-License-Identifier: MIT
"""The actions of the soak, as a function of its seed alone: an endless random list.

Nothing here looks at the bus, the clock or the machine. So the same seed is the same schedule. The
state that an action finds (a missing rule, a missing interface) does not change later actions.
"""

import json
import random
from typing import NamedTuple

INTERFACES = ("vcan0", "vcan1", "vcan2", "vx0")  # vx0 is an end of a vxcan pair, vx0e the other
UNIX = "unix:body.sock"
PORTS = dict(zip(("engine", "brakes", "dash", "gateway", "body"), (*INTERFACES, UNIX)))
NODES = (*PORTS, "load", "logger")  # the last two have no ECU
RULES_KEPT = 40  # older names are no longer cleared, fired or waited for
PAUSE_MEAN_S = 0.05

STATES = ("error-active", "error-warning", "error-passive", "bus-off")
BITS = ("sof", "id[3]", "rtr", "dlc[1]", "data[0.0]", "data[1.5]", "crc[3]", "crc-delimiter",
        "ack-slot", "ack-delimiter", "eof[0]", "eof[5]", "eof[6]", "intermission[0]",
        "intermission[2]", "suspend[3]", "stuff[0]", "stuff[2]", "bit[7]", "error-flag[2]",
        "error-delimiter[4]", "overload-flag[1]", "overload-delimiter[6]")


class Action(NamedTuple):
    pause_s: float  # before it
    name: str
    arguments: dict

    def __str__(self):
        return f"{self.pause_s:.3f} {self.name} {json.dumps(self.arguments)}"


# Frequencies of the actions; at first there is one of each, in any order.
WEIGHTS = {
    "burst": 40, "garbage_frames": 5, "reader": 4, "unix_ecu": 6,
    "inject": 16, "bad_inject": 3, "clear": 6, "clear_all": 2, "fire": 3, "rules_shown": 1,
    "set": 6, "bad_set": 1, "restart": 5,
    "reload": 5, "bad_reload": 3, "hangup": 2,
    "watch": 3, "vanish": 3, "flood": 2, "garbage": 3, "crowd": 1, "half_close": 1,
    "link": 8, "stop": 1, "clock": 1, "route": 1,
}


class Schedule:
    def __init__(self, seed):
        self.random = random.Random(f"canwire soak {seed}")
        self.links = dict.fromkeys(INTERFACES, "up")
        self.routed = True
        self.rules = []
        self.made = 0

    def __iter__(self):
        first = sorted(WEIGHTS)
        self.random.shuffle(first)
        for name in first:
            yield self.action(name)
        while True:
            yield self.action(self.random.choices(list(WEIGHTS), WEIGHTS.values())[0])

    def action(self, name):
        return Action(self.random.expovariate(1 / PAUSE_MEAN_S), name, getattr(self, name)())

    # ---- Small things ----------------------------------------------------------------------------

    def chance(self, probability):
        return self.random.random() < probability

    def node(self):
        return self.random.choice(NODES)

    def nodes(self):
        return self.random.sample(NODES, self.random.randint(1, 3))

    def time(self, low_us, high_us):
        """Draws a time; small ones are as likely as large ones."""
        return f"{int(low_us * (high_us / low_us) ** self.random.random())}us"

    def identifier(self):
        return f"{self.random.randrange(0x800):03X}" if self.chance(0.7) else (
            f"{self.random.randrange(0x20000000):08X}")

    def frame(self):
        if self.chance(0.1):
            return f"{self.identifier()}#R{self.random.randint(0, 8)}"
        data = self.random.randbytes(self.random.randint(0, 8))
        return f"{self.identifier()}#{data.hex().upper()}"

    def new_rule(self):
        self.made += 1
        self.rules = self.rules[-RULES_KEPT:] + [f"rule-{self.made}"]
        return self.rules[-1]

    # ---- ECUs ------------------------------------------------------------------------------------

    def burst(self):
        """Draws frames of one ECU at once; many of them saturate the bus and overflow the queue."""
        count = int(2 ** self.random.uniform(0, 9))
        return {"port": self.random.choice((*INTERFACES, UNIX)), "count": count,
                "seed": self.random.randrange(1 << 32)}

    def garbage_frames(self):
        """Writes objects that are no frames for a classical bus: error frames, FD frames, bad
        identifiers."""
        return {"port": self.random.choice((*INTERFACES, UNIX)),
                "count": self.random.randint(1, 30), "seed": self.random.randrange(1 << 32)}

    def reader(self):
        """Draws a program that listens, error frames included, and reads or does not."""
        return {"interface": self.random.choice(INTERFACES), "reads": self.chance(0.4)}

    def unix_ecu(self):
        return {"does": self.random.choice(("connect", "connect", "vanish", "second", "drain"))}

    # ---- Rules -----------------------------------------------------------------------------------

    def do(self):
        r, position = self.random, self.random.choice(BITS)
        lasting = {"for": self.time(100, 2_000_000)} if self.chance(0.8) else {}
        at = {"at": self.nodes()} if self.chance(0.4) else {}
        level = r.choice(("dominant", "recessive"))
        of_bits = [
            {"flip": position, "bits": r.randint(1, 20), **at},
            {"force": level, "from": position, "bits": r.randint(1, 30), **at},
            {"glitch": "".join(r.choices("01x", k=r.randint(1, 20))), "from": position, **at},
        ]
        others = [
            {"stuck": level, "on": r.choice(("wire", f"{self.node()}.tx", f"{self.node()}.rx")),
             **lasting},
            {"noise": f"{10 ** r.uniform(-6, -1):.2e}", **at, **lasting},
            {"no-ack": self.nodes(), **lasting},
            {"wrong-crc": self.nodes()}, {"bus-off": self.node()}, {"error-flag": self.nodes()},
            {"restart": self.nodes()},
            {"counters": self.node(), "tec": r.randint(0, 263), "rec": r.randint(0, 255)},
            {"overload": self.nodes(), "frames": r.randint(1, 2)},
            {"set": self.node(), **self.some_settings()},
            {"software-reset": self.nodes()}, {"hardware-reset": self.nodes()},
            {"raw": "".join(r.choices("01", k=r.randint(1, 192))), "as": self.node(),
             "start": r.choice(("idle", "at-once"))},
            {"raw": {"frame": "12345678#01", "srr": level}, "as": self.node(),
             "mac": r.choice(("on", "off"))},
            {"disconnect": self.nodes(), **lasting}, {"partition": self.groups(), **lasting},
            {"drop": "tx"}, {"drop": "rx", **at}, {"delay": self.time(10, 500_000), **at},
            {"duplicate": r.randint(1, 16), **at}, {"reorder": r.randint(1, 8), **at},
            {"change": {"id": self.identifier(), "xor": r.randbytes(2).hex().upper()}, **at},
            {"send": self.frame(), "as": self.node(), "every": self.time(200, 100_000), **lasting},
            {"babble": self.frame(), "as": self.node(), **lasting},
            {"load": f"{r.randint(1, 100)}%", "as": self.node(), **lasting},
            {"reply": self.frame(), "as": self.node(), "delay": self.time(1, 10_000)},
        ]
        return r.choice(of_bits if self.chance(0.3) else others)

    def groups(self):
        nodes = self.random.sample(NODES, self.random.randint(2, len(NODES)))
        cut = self.random.randint(1, len(nodes) - 1)
        return [nodes[:cut], nodes[cut:]]

    def when(self, action):
        """Conditions that the action allows."""
        r, when = self.random, {}
        of_frames = {"flip", "force", "glitch", "wrong-crc", "drop", "delay", "duplicate",
                     "reorder", "change", "reply"} & set(action)
        if of_frames or self.chance(0.5):
            if self.chance(0.2):
                when["frame"] = f"{r.randrange(0x800):03X}:{r.choice(('000', '001', '003', '700'))}"
            if self.chance(0.2):
                when["from"] = self.nodes()
        elif self.chance(0.2):
            when["frame"] = "#" + r.choice(("4", "40", "88", "20", "100", "FFFFFFFF"))
        elif self.chance(0.2):
            when["manual"] = True
        if self.chance(0.15):
            when["state"] = {self.node(): r.choice(STATES)}
        if self.chance(0.1) and self.rules and "manual" not in when:
            when["after"] = {"rule": r.choice(self.rules), "delay": self.time(1, 100_000)}
        for key, value in (("skip", r.randint(0, 5)), ("every", r.randint(1, 20)),
                           ("count", r.randint(1, 50)), ("hold-off", self.time(1, 10_000)),
                           ("probability", round(r.random(), 3))):
            if self.chance(0.3):
                when[key] = value
        return when

    def rule(self):
        do = self.do()
        when = self.when(do)
        rule = {"name": self.new_rule(), "do": do}
        return rule | ({"when": when} if when else {})

    def inject(self):
        return {"text": json.dumps([self.rule() for _ in range(self.random.choice((1, 1, 2, 6)))])}

    def bad_inject(self):
        text = self.random.choice((
            "{", "", "- - -", '{"name":"x"}', '{"name":"x","do":{"flop":1}}',
            '{"name":"x","do":{"bus-off":"nobody"}}', json.dumps([{"name": "x"}] * 5000),
            "&a [*a]", "[" * 500, "{name: x, do: {noise: 2}}", "\x00\x01", "'" * 70000))
        return {"text": text}

    def clear(self):
        return {"rule": self.random.choice(self.rules or ["none"])}

    def clear_all(self):
        self.rules = []
        return {"injected": self.chance(0.5)}

    def fire(self):
        return {"rule": self.random.choice(self.rules or ["none"])}

    def rules_shown(self):
        return {}

    # ---- Settings and configurations -------------------------------------------------------------

    def some_settings(self):
        r = self.random
        possible = {
            "one-shot": self.chance(0.3), "listen-only": self.chance(0.2),
            "loopback": self.chance(0.2), "presume-ack": self.chance(0.3),
            "lost-arbitration-reporting": self.chance(0.5),
            "berr-reporting": self.chance(0.5), "restart-ms": r.choice((0, 1, 50, 500)),
            "queue": r.choice((1, 2, 16, 300, 4096)), "order": r.choice(("priority", "fifo")),
            "warning-limit": r.randint(1, 255),
        }
        return {key: possible[key] for key in r.sample(list(possible), r.randint(1, 4))}

    def set(self):
        return {"node": self.node(), "settings": self.some_settings()}

    def bad_set(self):
        return {"node": self.random.choice((*NODES, "nobody")), "settings": self.random.choice((
            {"queue": 0}, {"restart-ms": -1}, {"order": "none"}, {"tec": 5}, {}))}

    def restart(self):
        return {"node": self.node()}

    def config(self):
        """Draws some of the nodes, in any order, some with another port, and some rules."""
        r = self.random
        names = r.sample(NODES, r.randint(2, len(NODES)))
        ports = dict(PORTS)
        if self.chance(0.3):
            a, b = r.sample(list(PORTS), 2)
            ports[a], ports[b] = ports[b], ports[a]
        nodes = []
        for name in names:
            node = {"name": name}
            if self.chance(0.6):
                node |= self.some_settings()
            if name in ports and self.chance(0.9):
                node["port"] = ports[name]
            elif self.chance(0.7):
                node["traffic"] = self.traffic()
            nodes.append(node)
        config = base_config() | {"nodes": nodes}
        config["pacing"] = r.choice(("precise", "precise", "tick"))
        config["catch-up"] = r.choice(("50ms", "1s", "10s"))
        config["lcm"]["period"] = r.choice(("50ms", "1s"))
        if self.chance(0.5):
            config["faults"] = self.rules_for(names)
        return config

    def traffic(self):
        entries = [{"send": self.frame(), "every": self.time(300, 200_000),
                    "jitter": self.time(1, 1000)} for _ in range(self.random.randint(1, 3))]
        if self.chance(0.3):
            entries.append({"reply": self.frame(), "to": f"{self.random.randrange(0x800):03X}:007"})
        return entries

    def rules_for(self, names):
        """Draws rules of a file, which name nodes of that file."""
        rules = [self.rule() for _ in range(3)]
        return [r for r in rules if "after" not in r.get("when", {})
                and all(n in names for n in NODES if f'"{n}' in json.dumps(r))]

    def reload(self):
        return {"config": base_config() if self.chance(0.4) else self.config()}

    hangup = reload

    def bad_reload(self):
        """Draws a bad file: a wrong key, a forbidden change, no text or no file at all."""
        config = self.config()
        kind = self.random.choice(
            ("key", "bitrate", "name", "node", "binary", "cut", "gone", "empty"))
        if kind == "key":
            config["colour"] = "blue"
        elif kind == "bitrate":
            config["bus"]["bitrate"] = 250000
        elif kind == "name":
            config["bus"]["name"] = "another"
        elif kind == "node":
            config["faults"] = [{"name": "x", "do": {"bus-off": "nobody"}}]
        return {"kind": kind, "config": config, "signal": self.chance(0.3)}

    # ---- Clients ---------------------------------------------------------------------------------

    def watch(self):
        return {"reads": self.chance(0.4)}

    def vanish(self):
        """Lets a client go in the middle of a line, or with unread replies."""
        return {"after": self.random.choice(('{"request":"sta', '{"request":"status"}\n' * 20,
                                             '{"request":"watch"}\n'))}

    def flood(self):
        return {"requests": self.random.randint(50, 2000)}

    def garbage(self):
        size = int(2 ** self.random.uniform(0, 18))
        return {"size": size, "seed": self.random.randrange(1 << 32), "lines": self.chance(0.5)}

    def crowd(self):
        return {"clients": self.random.randint(20, 90)}

    def half_close(self):
        return {}

    # ---- Machine ---------------------------------------------------------------------------------

    def link(self):
        """Removes an interface in one of many ways; a missing one comes back."""
        name = self.random.choice(INTERFACES)
        state = self.links[name]
        ways = ["down", "deleted", "renamed", "mtu", "flap", "anew"]
        if name == "vx0":
            ways += ["peer-down"]
        way = self.random.choice(ways) if state == "up" else f"back-from-{state}"
        self.links[name] = way if state == "up" and way not in ("flap", "anew") else "up"
        return {"interface": name, "way": way}

    def stop(self):
        return {"seconds": round(self.random.uniform(0.05, 2), 3)}

    def clock(self):
        return {"seconds": self.random.choice((-86400, -10, -1, 1, 10, 86400))}

    def route(self):
        self.routed = not self.routed
        return {"there": self.routed}


def base_config():
    """Returns the initial configuration, to which the soak returns."""
    nodes = [{"name": name, "port": port, "restart-ms": 100} for name, port in PORTS.items()]
    nodes[0]["berr-reporting"] = True
    nodes[0]["lost-arbitration-reporting"] = True
    nodes.append({"name": "load", "restart-ms": 100, "traffic": [
        {"send": "123#DEADBEEF", "every": "5ms", "jitter": "1ms"},
        {"reply": "7FF#CAFE", "to": "700:700", "delay": "1ms"}]})
    nodes.append({"name": "logger", "listen-only": True, "restart-ms": 100})
    return {
        "bus": {"name": "soak", "bitrate": 500000}, "seed": 1, "nodes": nodes,
        "control": "soak.sock", "missing-port": "wait",
        "lcm": {"url": "udpm://239.255.76.67:7667?ttl=0", "period": "100ms",
                "events": ["error", "state", "restart", "overload", "drop", "fault", "tx"]},
    }
