#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The rest of a bus from a database of messages, as a configuration of canwire."""

import argparse
import difflib
import itertools
import pathlib
import re
import sys

BITRATE, DBITRATE = 500000, 2000000
NAME_MAX = 32  # characters of a node
VARIANTS_MAX = 256  # of one multiplexed message
FD_LENGTHS = (8, 12, 16, 20, 24, 32, 48, 64)
KEYS = ("dbc", "message", "signals")  # of an entry to be resolved
OTHERS = ("every", "offset", "jitter", "count", "counter", "checksum")


class Problem(Exception):
    """A message for the user."""


def packages():
    """Imports what is needed, or says how to install it."""
    try:
        import cantools
        import yaml
    except ImportError as missing:
        raise Problem(f"the Python package {missing.name} is missing; install it with "
                      f"'pip install cantools pyyaml'") from None
    return cantools, yaml


def warn(text):
    print(f"canwire-restbus: {text}", file=sys.stderr)


# ---- Databases -----------------------------------------------------------------------------------


def load(path):
    """Returns a database of any format of cantools: DBC, ARXML, KCD, SYM, CDD."""
    cantools, _ = packages()
    try:
        database = cantools.database.load_file(path, strict=False)
    except OSError as problem:
        raise Problem(f"{path}: {problem.strerror}") from None
    except Exception as problem:  # each format has errors of its own
        raise Problem(f"{path}: {problem}") from None
    if not hasattr(database, "messages"):
        raise Problem(f"{path}: this is no database of messages")
    return database


def attribute(message, name, default=None):
    found = message.dbc.attributes.get(name) if message.dbc else None
    return found.value if found is not None else default


def sender_of(message):
    """Returns the node that sends the message, or None."""
    return next((s for s in message.senders if s and s != "Vector__XXX"), None)


def identifier(message):
    return f"{message.frame_id:08X}" if message.is_extended_frame else f"{message.frame_id:03X}"


def frame_text(message, data):
    """Returns the frame as can-utils write it."""
    if not message.is_fd:
        return f"{identifier(message)}#{data.hex().upper()}"
    length = next(n for n in (*range(8), *FD_LENGTHS) if n >= len(data))
    flags = 1 if int(attribute(message, "CANFD_BRS", 1)) else 0
    return f"{identifier(message)}##{flags}{data.ljust(length, bytes(1)).hex().upper()}"


# ---- Content of messages -------------------------------------------------------------------------


def variants(tree):
    """Returns the variants of a tree of signals of cantools, as pairs: the values of its
    multiplexers, and the names of the other signals."""
    parts = []
    for item in tree:
        if isinstance(item, str):
            parts.append([({}, [item])])
            continue
        for selector, choices in item.items():
            parts.append([({selector: value, **more}, names)
                          for value, below in choices.items() for more, names in variants(below)])
    return [({key: value for chosen, _ in combination for key, value in chosen.items()},
             [name for _, names in combination for name in names])
            for combination in itertools.islice(itertools.product(*parts), VARIANTS_MAX)]


def initial(signal):
    """Returns the raw value with which a signal begins."""
    return signal.raw_initial if signal.raw_initial is not None else 0


def encode(message, selectors, names, values):
    """Returns the data of a message, of raw values; those that are not given are the first ones."""
    raw = {name: initial(message.get_signal_by_name(name)) for name in names}
    raw.update(selectors)
    raw.update(values)
    return bytes(message.encode(raw, scaling=False, padding=False, strict=False))


def contents(message):
    """Returns the data of each variant of a message."""
    return [encode(message, selectors, names, {})
            for selectors, names in variants(message.signal_tree)]


def protection(message):
    """Returns the key `checksum` for a message with a profile of AUTOSAR that canwire has."""
    e2e = message.autosar.e2e if message.autosar else None
    found = re.search(r"(\d+)", str(e2e.category)) if e2e and e2e.category else None
    profile = int(found[1]) if found else None
    ids = list(e2e.data_ids or []) if e2e else []
    if profile in (2, 22) and len(ids) == 16:
        return f", checksum: {{ kind: e2e-p{profile}, at: 0, data-id: {ids} }}"
    if profile in (1, 5, 11) and len(ids) == 1:
        return f", checksum: {{ kind: e2e-p{profile}, at: 0, data-id: {ids[0]} }}"
    return ""


# ---- The rest of a bus ---------------------------------------------------------------------------


def entries(message):
    """Yields the lines of `traffic` for a message, and comments for what is not sent."""
    cycle = message.cycle_time
    if message.length > (64 if message.is_fd else 8) or getattr(message, "is_container", False):
        warn(f"{message.name} ({identifier(message)}) is no single frame and is left out")
        yield f"# {message.name}: no single frame"
        return
    frames = [frame_text(message, data) for data in contents(message)]
    if not cycle:
        yield f"# {{ send: {frames[0]} }} # {message.name}: no cycle time"
        return
    for i, frame in enumerate(frames):
        every = f"every: {cycle * len(frames):.12g}ms"
        offset = f", offset: {cycle * i:.12g}ms" if i else ""
        yield f"- {{ send: {frame}, {every}{offset}{protection(message)} }} # {message.name}"


def node_names(senders):
    """Returns names of nodes: what canwire does not allow is replaced, and long ones are cut."""
    names = {}
    for sender in senders:
        plain = re.sub(r"[^A-Za-z0-9_.-]", "_", sender)[:NAME_MAX] or "node"
        name, number = plain, 2
        while name in names.values():
            name, number = f"{plain[:NAME_MAX - 3]}-{number}", number + 1
        names[sender] = name
    return names


def find_senders(database, path, without, only):
    """Returns the senders that the configuration has, and their messages."""
    by_sender = {}
    for message in database.messages:
        sender = sender_of(message)
        if sender is None:
            warn(f"{path}: {message.name} ({identifier(message)}) has no sender and is left out")
            continue
        by_sender.setdefault(sender, []).append(message)
    known = sorted({*by_sender, *(node.name for node in database.nodes)})
    for name in [*without, *only]:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            guess = f" (did you mean '{near[0]}'?)" if near else ""
            raise Problem(f"{path}: there is no node '{name}'{guess}; nodes: {', '.join(known)}")
    return {sender: messages for sender, messages in by_sender.items()
            if sender not in without and (not only or sender in only)}


def rates(database, options, fd):
    """Returns the line of the configuration about the bus."""
    bus = next(iter(database.buses), None)
    bitrate = options.bitrate or (bus and bus.baudrate) or BITRATE
    text = f"bus: {{ name: {options.name}, bitrate: {bitrate}"
    if fd:
        text += f", dbitrate: {options.dbitrate or (bus and bus.fd_baudrate) or DBITRATE}"
    return text + " }"


def restbus(options):
    """Returns the configuration of all nodes of a database but some."""
    path = options.file
    database = load(path)
    found = find_senders(database, path, options.without, options.only)
    if not found:
        raise Problem(f"{path}: no node is left that sends")
    if options.name is None:
        options.name = re.sub(r"[^A-Za-z0-9_.-]", "_", pathlib.Path(path).stem)[:NAME_MAX] or "bus"
    names = node_names(found)
    fd = any(message.is_fd for messages in found.values() for message in messages)
    lines = [f"# {pathlib.Path(path).name}, by canwire-restbus", rates(database, options, fd),
             "nodes:"]
    lines += [f"  # - {{ name: {name}, port: vcan0 }} # the ECU itself"
              for name in options.without]
    for sender, messages in found.items():
        lines += [f"  - name: {names[sender]}"]
        sent = [line for message in messages for line in entries(message)]
        if any(line.startswith("-") for line in sent):
            lines += ["    traffic:"]
        lines += [f"      {line}" for line in sent]
    return "\n".join(lines) + "\n"


# ---- Entries of a configuration ------------------------------------------------------------------


class Entry:
    """An entry of traffic that names a message of a database: a mapping node of PyYAML."""

    def __init__(self, file, node):
        self.file, self.node = file, node
        self.values = {}
        for key, value in node.value:
            self.values[key.value] = value
            if key.value not in KEYS + OTHERS:
                self.fail(key, f"traffic: unknown key '{key.value}'; allowed: "
                               f"{', '.join(KEYS + OTHERS)}")

    def fail(self, node, text):
        mark = node.start_mark
        raise Problem(f"{self.file}:{mark.line + 1}:{mark.column + 1}: {text}")

    def text(self, key):
        value = self.values.get(key)
        if value is None:
            self.fail(self.node, f"traffic: the key '{key}' is missing")
        if not isinstance(value.value, str) or not value.value:
            self.fail(value, f"{key}: expected a text")
        return value.value

    def message(self, databases):
        path = self.file.parent / self.text("dbc")
        if path not in databases:
            try:
                databases[path] = load(path)
            except Problem as problem:
                self.fail(self.values["dbc"], f"dbc: {problem}")
        name = self.text("message")
        for message in databases[path].messages:
            if message.name == name:
                return message
        known = [message.name for message in databases[path].messages]
        near = difflib.get_close_matches(name, known, 1)
        guess = f" (did you mean '{near[0]}'?)" if near else ""
        return self.fail(self.values["message"], f"message: {path.name} has no '{name}'{guess}")

    def raw(self, message):
        """Returns the raw values of the signals that the entry gives."""
        node = self.values.get("signals")
        if node is None:
            return {}
        if not isinstance(node.value, list) or node.id != "mapping":
            self.fail(node, "signals: expected a map such as { rpm: 2000 }")
        known = {signal.name: signal for signal in message.signals}
        result = {}
        for key, value in node.value:
            if key.value not in known:
                near = difflib.get_close_matches(key.value, known, 1)
                guess = f" (did you mean '{near[0]}'?)" if near else ""
                self.fail(key, f"signals: {message.name} has no '{key.value}'{guess}; it has "
                               f"{', '.join(known)}")
            result[key.value] = self.raw_of(known[key.value], value)
        return result

    def raw_of(self, signal, node):
        """Returns the raw value of a number, or of one of a signal's words."""
        words = {str(word): number for number, word in (signal.choices or {}).items()}
        if node.value in words:
            return words[node.value]
        try:
            value = float(node.value)
        except (TypeError, ValueError):
            expected = f"a number or one of {', '.join(words)}" if words else "a number"
            self.fail(node, f"{signal.name}: expected {expected}")
        raw = signal.conversion.numeric_scaled_to_raw(value)
        raw = raw if signal.is_float else round(raw)
        low = -(1 << (signal.length - 1)) if signal.is_signed else 0
        high = (1 << (signal.length - (1 if signal.is_signed else 0))) - 1
        limits = [limit for limit in (signal.minimum, signal.maximum) if limit is not None]
        outside = len(limits) == 2 and limits[0] < limits[1] and \
            not limits[0] <= value <= limits[1]
        if outside or (not signal.is_float and not low <= raw <= high):
            unit = f" {signal.unit}" if signal.unit else ""
            least = signal.minimum if outside else signal.conversion.raw_to_scaled(low, False)
            most = signal.maximum if outside else signal.conversion.raw_to_scaled(high, False)
            self.fail(node, f"{signal.name}: {node.value} is not {least}..{most}{unit}")
        return raw

    def frame(self, message):
        """Returns the frame: of the variant with all signals that are given."""
        raw = self.raw(message)
        all_variants = variants(message.signal_tree)
        for selectors, names in all_variants:
            if all(name in names or raw[name] == selectors.get(name) for name in raw):
                return frame_text(message, encode(message, selectors, names, raw))
        return self.fail(self.values["signals"],
                         f"signals: {message.name} is multiplexed, and has no frame with all of "
                         f"these")

    def end(self, node):
        """Returns the index of the end of a node's text, without what follows a block."""
        if node.id == "scalar" or node.flow_style:
            return node.end_mark.index
        last = node.value[-1] if node.value else None
        if last is None:
            return node.end_mark.index
        return self.end(last[1] if isinstance(last, tuple) else last)

    def resolved(self, text, databases):
        """Returns begin and end of the entry in the text, and what replaces it."""
        message = self.message(databases)
        parts = [f"send: {self.frame(message)}"]
        if "every" not in self.values and message.cycle_time:
            parts.append(f"every: {message.cycle_time:.12g}ms")
        for key, value in self.node.value:
            if key.value in OTHERS:
                kept = text[value.start_mark.index:self.end(value)]
                parts.append(f"{key.value}: {flow(value) if chr(10) in kept else kept}")
        end = self.end(self.node)
        return self.node.start_mark.index, end, "{ " + ", ".join(parts) + " }"


def flow(node):
    """Returns a node on one line."""
    if node.id == "mapping":
        return "{ " + ", ".join(f"{flow(k)}: {flow(v)}" for k, v in node.value) + " }"
    if node.id == "sequence":
        return "[" + ", ".join(map(flow, node.value)) + "]"
    return f'"{node.value}"' if node.style else node.value


def find_entries(file, node):
    """Yields the entries of all lists `traffic` that name a database."""
    for child in node.value if node.id == "sequence" else []:
        yield from find_entries(file, child)
    for key, value in node.value if node.id == "mapping" else []:
        if key.value == "traffic" and value.id == "sequence":
            for item in value.value:
                if item.id == "mapping" and any(k.value == "dbc" for k, _ in item.value):
                    yield Entry(file, item)
        else:
            yield from find_entries(file, value)


def resolve(options):
    """Returns a configuration in which frames stand for messages; all else stays as it is."""
    _, yaml = packages()
    file = pathlib.Path(options.file)
    try:
        text = file.read_text(encoding="utf-8")
        root = yaml.compose(text, Loader=yaml.BaseLoader)
    except OSError as problem:
        raise Problem(f"{file}: {problem.strerror}") from None
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark
        raise Problem(f"{file}:{mark.line + 1}:{mark.column + 1}: {problem.problem}") from None
    databases = {}
    found = list(find_entries(file, root)) if root is not None else []
    if not found:
        warn(f"{file}: no traffic names a database ('dbc')")
    for begin, end, entry in reversed([e.resolved(text, databases) for e in found]):
        text = text[:begin] + entry + text[end:]
    return text


# ---- Command line --------------------------------------------------------------------------------


def arguments(argv):
    parser = argparse.ArgumentParser(
        prog="canwire-restbus", formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="canwire-restbus DATABASE [--without NODE]... [--only NODE]... [options]\n"
              "       canwire-restbus FILE.yaml",
        description="""\
Writes a configuration of canwire to standard output: of DATABASE the nodes that send, with their
periodic messages, or FILE.yaml with frames in place of the messages that it names.

DATABASE is DBC, ARXML, KCD or SYM. A node of it becomes a node with traffic: each message at its
cycle time with its initial values, a multiplexed one in turn. Messages without a cycle time are
comments. Messages without a sender are reported and left out.

In FILE.yaml an entry of `traffic` may be { dbc: FILE, message: NAME, signals: { NAME: VALUE } },
with the keys of `send` beside these. Values are physical ones, or words of the database. Signals
that are not named have their initial values. Without `every` the cycle time is the message's.""",
        epilog="exit status: 0, 1 bad input, 2 wrong usage")
    parser.add_argument("file", metavar="FILE", help=argparse.SUPPRESS)
    parser.add_argument("--without", metavar="NODE", action="append", default=[],
                        help="leave out this node: the ECU itself")
    parser.add_argument("--only", metavar="NODE", action="append", default=[],
                        help="only this node; several are allowed")
    parser.add_argument("--name", help="name of the bus; by default that of the file")
    parser.add_argument("--bitrate", type=int, metavar="N",
                        help="bit rate; by default that of the database, else 500000")
    parser.add_argument("--dbitrate", type=int, metavar="N",
                        help="that of the data phase of CAN FD; by default 2000000")
    options = parser.parse_args(argv)
    if options.file.endswith((".yaml", ".yml")) and (options.without or options.only):
        parser.error("--without and --only are for databases")
    return options


def main(argv=None):
    """Runs the command; returns its exit status."""
    options = arguments(argv)
    try:
        is_yaml = options.file.endswith((".yaml", ".yml"))
        sys.stdout.write(resolve(options) if is_yaml else restbus(options))
    except Problem as problem:
        warn(problem) if not re.match(r".*:\d+:\d+: ", str(problem)) else \
            print(problem, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
