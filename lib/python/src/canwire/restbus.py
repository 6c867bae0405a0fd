#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""The rest of a bus from a database of messages, as a configuration of canwire."""

import argparse
import difflib
import fractions
import itertools
import json
import logging
import math
import os
import pathlib
import re
import sys
import xml.etree.ElementTree

BITRATE, DBITRATE = 500000, 2000000
NAME_MAX = 32  # characters of a node
TRAFFIC_MAX = 4096  # entries of one node, and frames of its queue
QUEUE = 16  # of a node without the key
SHOWN = 5  # names in a line about several messages
UNITS = {"us": fractions.Fraction(1, 1000), "ms": 1, "s": 1000}
FLOAT_MAX = {16: 65504, 32: (2 ** 24 - 1) << 104, 64: (2 ** 53 - 1) << 971}
NEAR = 1e-14  # of a number: tools write 15 digits of numbers of 64 bits
FD_LENGTHS = (8, 12, 16, 20, 24, 32, 48, 64)
KEYS = ("dbc", "message", "signals")  # of an entry to be resolved
OTHERS = ("every", "offset", "jitter", "count", "counter", "checksum")


class Problem(Exception):
    """A message for the user."""


class PlacedProblem(Problem):
    """A message that begins with its place in a file."""


def packages():
    """Imports what is needed, or says how to install it."""
    try:
        import cantools
        import yaml
    except ImportError as missing:
        apart = "" if sys.prefix != sys.base_prefix else (
            "python3 -m venv ~/.canwire && . ~/.canwire/bin/activate && ")
        raise Problem(f"the Python package {missing.name} is missing; install it with "
                      f"'{apart}pip install cantools pyyaml'") from None
    return cantools, yaml


def warn(text):
    print(f"canwire-restbus: {text}", file=sys.stderr)


# ---- Databases -----------------------------------------------------------------------------------


def meant(name, known):
    """Returns the name that was probably meant, for a message, or without one all that there are.
    """
    near = difflib.get_close_matches(name, known, 1)
    return f" (did you mean '{near[0]}'?)" if near else f"; it has {', '.join(known)}"


def read(path, strict):
    """Returns what cantools reads, or raises Problem."""
    cantools, _ = packages()
    try:
        return cantools.database.load_file(path, strict=strict)
    except OSError as problem:
        raise Problem(f"{path}: {problem.strerror}") from None
    except Exception as problem:  # each format has errors of its own
        text = " ".join(str(problem).split()) or type(problem).__name__
        raise Problem(f"{path}: {text}") from None


def load(path, strict=True):
    """Returns a database of any format of cantools: DBC, ARXML, KCD, SYM, CDD."""
    try:
        database = read(path, strict)
    except Problem as problem:
        if not strict or not readable(path):
            raise
        raise Problem(f"{problem}; --no-strict skips this check") from None
    if not hasattr(database, "messages"):
        raise Problem(f"{path}: this is no database of messages")
    add_protection_places(database, path)
    return database


def readable(path):
    """Returns true when cantools reads a database without its checks."""
    try:
        read(path, False)
    except Problem:
        return False
    return True


def attribute(message, name, default=None):
    found = message.dbc.attributes.get(name) if message.dbc else None
    return found.value if found is not None else default


def default_of(message, name):
    """Returns the default of an attribute in its database, or None."""
    known = message.dbc.attribute_definitions.get(name) if message.dbc else None
    return known.default_value if known else None


def sender_of(message):
    """Returns the node that sends the message, or None."""
    return next((s for s in message.senders if s and s != "Vector__XXX"), None)


def tell(path, messages, total, one, several, hint):
    """Warns about messages: all of them on one line."""
    if not messages:
        return
    names = [f"{plain(m.name)} ({identifier(m)})" for m in messages]
    if len(names) == 1:
        warn(f"{path}: {names[0]} {one}{hint}")
        return
    shown = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more"
                                        if len(names) > SHOWN else "")
    warn(f"{path}: {len(names)} of {total} messages {several}: {shown}{hint}")


def plain(text):
    """Returns a text as a comment has it: on one line."""
    return " ".join(str(text).split())


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


def names_in(tree):
    """Returns the names of all signals of a tree of cantools, with the multiplexers."""
    found = set()
    for item in tree:
        if isinstance(item, str):
            found.add(item)
        else:
            found.update(item)
            found.update(*(names_in(below) for c in item.values() for below in c.values()))
    return found


def count_variants(tree):
    """Returns how many variants a tree of signals has."""
    return math.prod(sum(count_variants(below) for below in choices.values())
                     for item in tree if not isinstance(item, str) for choices in item.values())


def variants(tree):
    """Yields the variants of a tree of signals, as pairs: the values of its multiplexers, and the
    names of the other signals."""
    plain_names = [item for item in tree if isinstance(item, str)]
    parts = [(selector, choices) for item in tree if not isinstance(item, str)
             for selector, choices in item.items()]

    def combine(rest, selectors, names):
        if not rest:
            yield selectors, names
            return
        (selector, choices), *others = rest
        for value, below in choices.items():
            for more, found in variants(below):
                yield from combine(others, {**selectors, selector: value, **more}, names + found)

    yield from combine(parts, {}, plain_names)


def choose(selector, choices, raw, start):
    """Returns the page of one multiplexer, or None: the one with all signals of `raw`, and of
    several the one with which the message begins."""
    wanted = raw.keys() & names_in([{selector: choices}])
    for value in sorted(choices, key=lambda value: value != start.get(selector)):
        if raw.get(selector, value) != value:
            continue
        found = find_variant(choices[value], raw, start)
        if found is not None and wanted <= {selector, *found[0], *found[1]}:
            return {selector: value, **found[0]}, found[1]
    return None


def find_variant(tree, raw, start):
    """Returns the variant of a tree that has all signals of `raw`, or None."""
    selectors, names = {}, []
    for item in tree:
        if isinstance(item, str):
            names.append(item)
            continue
        for selector, choices in item.items():
            found = choose(selector, choices, raw, start)
            if found is None:
                return None
            selectors.update(found[0])
            names += found[1]
    return selectors, names


def limits_of(signal):
    """Returns the least and the greatest raw value of a signal that is no float."""
    if signal.is_signed:
        return -(1 << (signal.length - 1)), (1 << (signal.length - 1)) - 1
    return 0, (1 << signal.length) - 1


def fitting(signal, value):
    """Returns a raw value as the signal can have it, or None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    if signal.is_float:
        return float(value)
    if not math.isfinite(value) or value != int(value):
        return None
    low, high = limits_of(signal)
    raw = int(value)
    if isinstance(value, float) and high < raw <= high * (1 + NEAR):
        return high
    return raw if low <= raw <= high else None


def initial(message, signal):
    """Returns the raw value with which a signal begins."""
    if signal.raw_initial is not None:
        raw = fitting(signal, signal.raw_initial)
        if raw is None:
            warn(f"{message.name} ({identifier(message)}): {signal.name} cannot begin with "
                 f"{signal.raw_initial}, and begins with 0")
        return raw or 0
    known = signal.dbc.attribute_definitions.get("GenSigStartValue") if signal.dbc else None
    return fitting(signal, known.default_value) or 0 if known else 0


def beginning(message):
    """Returns the raw values with which all signals of a message begin."""
    return {signal.name: initial(message, signal) for signal in message.signals}


def encode(message, variant, values):
    """Returns the data of a variant of a message, of raw values."""
    selectors, names = variant
    raw = {name: values[name] for name in names}
    raw.update(selectors)
    try:
        return bytes(message.encode(raw, scaling=False, padding=False, strict=False))
    except Exception as problem:  # of cantools and bitstruct
        raise Problem(f"{message.name} ({identifier(message)}) cannot be encoded: "
                      f"{plain(problem) or type(problem).__name__}") from None


def contents(message):
    """Returns the data of each variant of a message; the one with which it begins is the first."""
    start = beginning(message)
    first = find_variant(message.signal_tree, {}, start)
    total = count_variants(message.signal_tree)
    rest = itertools.islice((v for v in variants(message.signal_tree) if v[0] != first[0]),
                            TRAFFIC_MAX - 1)
    if total > TRAFFIC_MAX:
        warn(f"{message.name} ({identifier(message)}) has {total} pages; {TRAFFIC_MAX} are sent")
    return [encode(message, variant, start) for variant in (first, *rest)]


# ---- End-to-end protection -----------------------------------------------------------------------

PLACES = {"DATA-OFFSET": 0, "OFFSET": 0, "CRC-OFFSET": 0, "COUNTER-OFFSET": None,
          "DATA-ID-NIBBLE-OFFSET": None, "DATA-ID-MODE": None, "DATA-LENGTH": None}
MODES = {"ALL-16-BIT": "both", "ALTERNATING-8-BIT": "alt", "LOWER-8-BIT": "low",
         "LOWER-12-BIT": "nibble", "0": "both", "1": "alt", "2": "low", "3": "nibble"}


def local(element):
    """Returns the name of an element of XML without its namespace."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def places_in(element):
    """Returns what an element of ARXML says of the places of a profile."""
    return {local(child): (child.text or "").strip() for child in element.iter()
            if local(child) in PLACES and (child.text or "").strip()}


def by_path(root):
    """Returns the elements of an ARXML file by their paths."""
    found = {}

    def walk(element, path):
        name = next((e.text for e in element if local(e) == "SHORT-NAME"), None)
        if name:
            path = f"{path}/{name.strip()}"
            found[path] = element
        for child in element:
            walk(child, path)

    walk(root, "")
    return found


def references(element, name):
    """Returns the paths in an element of ARXML of the references of that name."""
    return [(e.text or "").strip() for e in element.iter() if local(e) == name]


def protections_of(root):
    """Yields the path of each protected PDU of an ARXML file, and the places of its profile.
    cantools does not tell them. Either a set of protections has them, or a transformer."""
    elements = by_path(root)
    for protection in root.iter():
        if local(protection) == "END-TO-END-PROTECTION":
            profile = next((e for e in protection if local(e) == "END-TO-END-PROFILE"), None)
            places = {} if profile is None else places_in(profile)
            for pdu in protection.iter():
                if local(pdu) == "END-TO-END-PROTECTION-I-SIGNAL-I-PDU":
                    for path in references(pdu, "I-SIGNAL-I-PDU-REF"):
                        yield path, {**places, **places_in(pdu)}
    for path, pdu in elements.items():
        for group in references(pdu, "I-SIGNAL-GROUP-REF") if local(pdu).endswith("PDU") else []:
            properties = [e for e in elements.get(group, ())
                          if local(e) == "TRANSFORMATION-I-SIGNAL-PROPSS"]
            for transformer in [t for e in properties for t in references(e, "TRANSFORMER-REF")]:
                if transformer in elements:
                    yield path, {**places_in(elements[transformer]), **places_in(properties[0])}


def add_protection_places(database, path):
    """Notes where the protections of messages lie, as `canwire_places` of their properties."""
    protected = {path: message.autosar.e2e for message in database.messages
                 if message.autosar and message.autosar.e2e for path in message.autosar.pdu_paths}
    if not protected:
        return
    for pdu, places in protections_of(xml.etree.ElementTree.parse(path).getroot()):
        if pdu in protected:
            protected[pdu].canwire_places = places


def bit_text(bits):
    """Returns the place of a half of a byte: AUTOSAR counts from the least significant bit."""
    return f'"{bits // 8}.{0 if bits % 8 >= 4 else 4}"'


def profile_keys(message, profile, ids):
    """Returns the keys of a profile; raises ValueError with what canwire does not have."""
    e2e = message.autosar.e2e
    said = {**PLACES, **getattr(e2e, "canwire_places", {})}
    start, header, crc = (int(said[key], 0) if said[key] else 0
                          for key in ("DATA-OFFSET", "OFFSET", "CRC-OFFSET"))
    length = int(said["DATA-LENGTH"] or "0", 0) // 8
    if start or {length, e2e.payload_length} - {0, message.length}:
        raise ValueError("only a part of its data is protected")
    place = header + (crc if profile in (1, 11) else 0)
    if place % 8:
        raise ValueError(f"its checksum is at bit {place}")
    keys = [f"kind: e2e-p{profile}", f"at: {place // 8}",
            f"data-id: {ids if profile in (2, 22) else ids[0]}"]
    if profile not in (1, 11):
        return [f"checksum: {{ {', '.join(keys)} }}"]
    mode = MODES.get(re.sub("[_ ]", "-", said["DATA-ID-MODE"] or "0").upper())
    if mode is None:
        raise ValueError(f"its mode is {said['DATA-ID-MODE']}")
    if mode != "both":
        keys.append(f"data-id-mode: {mode}")
    if mode == "nibble" and said["DATA-ID-NIBBLE-OFFSET"]:
        keys.append(f"data-id-nibble: {bit_text(int(said['DATA-ID-NIBBLE-OFFSET'], 0))}")
    result = [f"checksum: {{ {', '.join(keys)} }}"]
    if said["COUNTER-OFFSET"]:
        result.insert(0, f"counter: {{ at: {bit_text(int(said['COUNTER-OFFSET'], 0) + header)} }}")
    return result


def protection(message):
    """Returns the keys `counter` and `checksum` for a message with a profile that canwire has."""
    e2e = message.autosar.e2e if message.autosar else None
    if e2e is None or not e2e.category or str(e2e.category).upper() == "NONE":
        return ""
    found = re.search(r"(\d+)", str(e2e.category))
    profile = int(found[1]) if found else None
    ids = list(e2e.data_ids or [])
    try:
        if profile not in (1, 2, 5, 11, 22):
            raise ValueError("canwire has the profiles 1, 2, 5, 11 and 22")
        if len(ids) != (16 if profile in (2, 22) else 1):
            raise ValueError(f"it has {len(ids)} Data IDs")
        return "".join(f", {key}" for key in profile_keys(message, profile, ids))
    except ValueError as problem:
        warn(f"{message.name} ({identifier(message)}) is sent without its protection "
             f"{plain(e2e.category)}: {plain(problem)}")
        return ""


# ---- The rest of a bus ---------------------------------------------------------------------------


# Words of `GenMsgSendType`. Others, such as NoMsgSendType, leave it to the cycle time.
AT_EVENTS = re.compile("event|spontan|onchange|onwrite|trigger|demand|request", re.IGNORECASE)
CYCLIC = re.compile("cyclic|periodic", re.IGNORECASE)
IF_ACTIVE = re.compile("if_?active", re.IGNORECASE)


def waits_for(message):
    """Returns the send type of a message that is not sent just because time goes by, or None."""
    kind = str(message.send_type or "")
    at_events = AT_EVENTS.search(kind) and not CYCLIC.search(kind)
    return kind if at_events or IF_ACTIVE.search(kind) else None


def cycle_of(message, options):
    """Returns the cycle time in ms, or None for a message that is not sent periodically."""
    if message.name in options.cycles:
        return options.cycles[message.name]
    own = message.cycle_time
    return own if own and own > 0 and not waits_for(message) else options.cycles.get(None)


def start_of(message):
    """Returns the start delay in ms that a database gives a message, or None."""
    delay = attribute(message, "GenMsgStartDelayTime",
                      default_of(message, "GenMsgStartDelayTime"))
    return delay if isinstance(delay, (int, float)) and delay > 0 else None


def is_single(message):
    return message.length <= (64 if message.is_fd else 8) and \
        not getattr(message, "is_container", False)


def ms(value):
    return f"{float(value):.12g}ms"


class Rest:
    """The messages of all nodes that are sent, and when."""

    def __init__(self, path, found, options):
        self.path, self.options = path, options
        self.messages = [message for messages in found.values() for message in messages]
        self.check_names()
        periodic = [m for m in self.messages if is_single(m) and cycle_of(m, options)]
        self.place = {id(message): place for place, message in enumerate(periodic)}

    def check_names(self):
        known = [message.name for message in self.messages]
        for name in self.options.cycles:
            if name is not None and name not in known:
                near = difflib.get_close_matches(name, known, 1)
                guess = f" (did you mean '{near[0]}'?)" if near else ""
                raise Problem(f"{self.path}: --cycle: no message '{name}' is sent{guess}")

    def offset(self, message, cycle):
        """Returns the time of the first release, in ms. Those without a start delay are spread
        over their cycle times, in whole microseconds, when that is asked for."""
        delay = start_of(message)
        if delay is not None:
            return delay
        if not self.options.spread:
            return 0
        part = fractions.Fraction(self.place[id(message)], len(self.place))
        return fractions.Fraction(math.floor(fractions.Fraction(cycle) * part * 1000), 1000)

    def entries(self, message):
        """Yields the lines of `traffic` for a message, and comments for what is not sent."""
        name = plain(message.name)
        if not is_single(message):
            warn(f"{name} ({identifier(message)}) is no single frame and is left out")
            yield f"# {name}: no single frame"
            return
        try:
            frames = [frame_text(message, data) for data in contents(message)]
        except Problem as problem:
            warn(f"{problem}; it is left out")
            yield f"# {name}: it cannot be encoded"
            return
        cycle = cycle_of(message, self.options)
        if not cycle:
            yield f"# {{ send: {frames[0]} }} # {name}: {waits_for(message) or 'no cycle time'}"
            return
        protected = protection(message)
        start = self.offset(message, cycle)
        for i, frame in enumerate(frames):
            every = f"every: {ms(cycle * len(frames))}"
            at = start + cycle * i
            offset = f", offset: {ms(at)}" if at else ""
            yield f"- {{ send: {frame}, {every}{offset}{protected} }} # {name}"

    def tell_collisions(self):
        """Says which frames of several nodes have the same identifier."""
        by_identifier = {}
        for message in self.messages:
            if id(message) in self.place:
                by_identifier.setdefault(identifier(message), []).append(message)
        for name, messages in by_identifier.items():
            if len({sender_of(m) for m in messages}) > 1:
                warn(f"{self.path}: several nodes send {name}, and destroy each other's frames: "
                     f"{', '.join(plain(m.name) for m in messages)}")

    def tell(self):
        """Says which messages are not sent periodically, and what changes that."""
        silent = [m for m in self.messages if is_single(m) and not cycle_of(m, self.options)]
        waiting = [m for m in silent if waits_for(m)]
        total = len(self.messages)
        tell(self.path, [m for m in silent if m not in waiting], total,
             "has no cycle time and is not sent", "have no cycle time and are not sent",
             "; --cycle TIME gives one to all, --cycle MESSAGE=TIME to one")
        kinds = ", ".join(sorted({waits_for(m) for m in waiting}))
        tell(self.path, waiting, total, f"is not sent: its send type is {kinds}",
             f"are not sent: their send type is {kinds}",
             "; --cycle TIME sends all, --cycle MESSAGE=TIME one")
        self.tell_collisions()
        if self.messages and not self.place:
            warn(f"{self.path}: no message is sent periodically: this bus is silent")
        elif len({sender_of(m) or self.options.sender for m in self.messages}) == 1:
            warn(f"{self.path}: only one node sends, and nobody acknowledges its frames; add "
                 f"another node, such as the ECU with its port")


def node_names(senders):
    """Returns names of nodes: what canwire does not allow is replaced, and long ones are cut."""
    names = {}
    for sender in senders:
        allowed = re.sub(r"[^A-Za-z0-9_.-]", "_", sender)[:NAME_MAX] or "node"
        name, number = allowed, 2
        while name in names.values():
            end = f"-{number}"
            name, number = f"{allowed[:NAME_MAX - len(end)]}{end}", number + 1
        names[sender] = name
    return names


def scalar(name):
    """Returns a name as YAML has it: in quotes where it would be read as something else."""
    harmless = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_.-]*", name) and \
        name.lower() not in ("null", "true", "false", "yes", "no", "on", "off", "y", "n")
    return name if harmless else f'"{name}"'


def find_senders(database, path, options):
    """Returns the senders that the configuration has, and their messages."""
    by_sender, without, only = {}, options.without, options.only
    for message in database.messages:
        by_sender.setdefault(sender_of(message) or options.sender, []).append(message)
    orphans = by_sender.pop(None, [])
    tell(path, orphans, len(database.messages), "has no sender and is left out",
         "have no sender and are left out", "; --sender NODE sends such messages")
    known = sorted({*by_sender, *(node.name for node in database.nodes)})
    for name in [*without, *only]:
        if name not in known:
            raise Problem(f"{path}: there is no node '{name}'{meant(name, known)}")
    return {sender: messages for sender, messages in by_sender.items()
            if sender not in without and (not only or sender in only)}


def rates(database, options, fd):
    """Returns the line of the configuration about the bus."""
    bus = next(iter(database.buses), None)
    bitrate = options.bitrate or (bus and bus.baudrate) or BITRATE
    text = f"bus: {{ name: {scalar(options.name)}, bitrate: {bitrate}"
    if fd:
        text += f", dbitrate: {options.dbitrate or (bus and bus.fd_baudrate) or DBITRATE}"
    return text + " }"


def restbus(options):
    """Returns the configuration of all nodes of a database but some."""
    path = options.file
    database = load(path, options.strict)
    found = find_senders(database, path, options)
    if not found:
        raise Problem(f"{path}: " + ("no node is left that sends" if database.messages else
                                     "it has no message"))
    rest = Rest(path, found, options)
    if options.name is None:
        options.name = re.sub(r"[^A-Za-z0-9_.-]", "_", pathlib.Path(path).stem)[:NAME_MAX] or "bus"
    names = node_names(found)
    fd = any(message.is_fd for messages in found.values() for message in messages)
    lines = [f"# {plain(pathlib.Path(path).name)}, by canwire-restbus",
             rates(database, options, fd), "nodes:"]
    lines += [f"  # - {{ name: {name}, port: vcan0 }} # the ECU itself"
              for name in node_names(options.without).values()]
    for sender, messages in found.items():
        lines += [f"  - name: {scalar(names[sender])}"]
        sent = [line for message in messages for line in rest.entries(message)]
        count = sum(line.startswith("-") for line in sent)
        if count > TRAFFIC_MAX:
            raise Problem(f"{path}: {sender} sends more than the {TRAFFIC_MAX} entries that the "
                          f"traffic of a node can have")
        if count > QUEUE:
            lines += [f"    queue: {count}"]
        if count > 0:
            lines += ["    traffic:"]
        lines += [f"      {line}" for line in sent]
    rest.tell()
    return "\n".join(lines) + "\n"


# ---- Documents -----------------------------------------------------------------------------------


class Alias:
    """An alias in a document, such as *rpm, and the node that it stands for."""

    def __init__(self, event, target):
        self.start_mark, self.end_mark, self.target = event.start_mark, event.end_mark, target


def target_of(node):
    return node.target if isinstance(node, Alias) else node


def placed(file, mark, text):
    return PlacedProblem(f"{file}:{mark.line + 1}:{mark.column + 1}: {text}")


def compose(text, file):
    """Returns the root of a document, in which aliases are nodes of their own; and the aliases."""
    _, yaml = packages()
    aliases = []

    class Loader(yaml.BaseLoader):
        def compose_node(self, parent, index):
            if not self.check_event(yaml.AliasEvent):
                self.open_nodes = [*getattr(self, "open_nodes", []), self.peek_event().anchor]
                node = super().compose_node(parent, index)
                self.open_nodes = self.open_nodes[:-1]
                return node
            event = self.peek_event()
            if event.anchor in self.open_nodes:
                name = event.anchor
                raise placed(file, event.start_mark, f"*{name} is inside of &{name}")
            aliases.append(Alias(event, target_of(super().compose_node(parent, index))))
            return aliases[-1]

    try:
        return yaml.compose(text, Loader=Loader), aliases
    except yaml.MarkedYAMLError as problem:
        raise placed(file, problem.problem_mark, problem.problem) from None
    except yaml.reader.ReaderError as problem:
        line = text.count("\n", 0, problem.position) + 1
        column = problem.position - text.rfind("\n", 0, problem.position)
        raise PlacedProblem(f"{file}:{line}:{column}: this character is not allowed") from None
    except RecursionError:
        raise Problem(f"{file}: values are too deep in others") from None


def flow(node):
    """Returns a node on one line, without anchors and aliases."""
    node = target_of(node)
    if node.id == "mapping":
        return "{ " + ", ".join(f"{flow(k)}: {flow(v)}" for k, v in node.value) + " }"
    if node.id == "sequence":
        return "[" + ", ".join(map(flow, node.value)) + "]"
    harmless = not node.style and re.fullmatch(r"[\w.+/~#-]+( [\w.+/~-]+)*", node.value)
    return node.value if harmless else json.dumps(node.value, ensure_ascii=False)


def end_of(node):
    """Returns the index of the end of a node's text, without what follows a block."""
    if isinstance(node, Alias) or node.id == "scalar" or node.flow_style or not node.value:
        return node.end_mark.index
    last = node.value[-1]
    return end_of(last[1] if isinstance(last, tuple) else last)


# ---- Entries of a configuration ------------------------------------------------------------------


def exact(text):
    """Returns the number of a text, as a whole number or a fraction; or None."""
    if re.fullmatch(r"[-+]?0x[0-9a-fA-F]{1,32}", text):
        return int(text, 16)
    if re.fullmatch(r"[-+]?(\d{1,400}\.?\d{0,400}|\.\d{1,400})([eE][-+]?\d{1,3})?", text):
        return fractions.Fraction(text)
    return None


class Entry:
    """An entry of traffic that names a message of a database: a mapping node of PyYAML."""

    def __init__(self, file, node):
        self.file, self.node = file, node
        self.values = {}
        for key, value in node.value:
            name = target_of(key).value
            if not isinstance(name, str) or name not in KEYS + OTHERS:
                self.fail(key, f"traffic: unknown key '{name if isinstance(name, str) else '?'}'; "
                               f"allowed: {', '.join(KEYS + OTHERS)}")
            if name in self.values:
                self.fail(key, f"traffic: the key '{name}' is there twice")
            self.values[name] = value

    def fail(self, node, text):
        raise placed(self.file, node.start_mark, text)

    def text(self, key):
        value = self.values.get(key)
        if value is None:
            self.fail(self.node, f"traffic: the key '{key}' is missing")
        text = target_of(value).value
        if not isinstance(text, str) or not text:
            self.fail(value, f"{key}: expected a text")
        return text

    def message(self, databases, strict):
        path = self.file.parent / self.text("dbc")
        if path not in databases:
            try:
                databases[path] = load(path, strict)
            except Problem as problem:
                self.fail(self.values["dbc"], f"dbc: {problem}")
        name = self.text("message")
        for message in databases[path].messages:
            if message.name == name:
                return message
        known = [message.name for message in databases[path].messages]
        return self.fail(self.values["message"],
                         f"message: {path.name} has no '{name}'{meant(name, known)}")

    def raw(self, message):
        """Returns the raw values of the signals that the entry gives."""
        at = self.values.get("signals")
        if at is None:
            return {}
        node = target_of(at)
        if node.id != "mapping":
            self.fail(at, "signals: expected a map such as { rpm: 2000 }")
        known = {signal.name: signal for signal in message.signals}
        result = {}
        for key, value in node.value:
            name = target_of(key).value
            if not isinstance(name, str) or name not in known:
                name = name if isinstance(name, str) else "?"
                self.fail(key, f"signals: {message.name} has no '{name}'{meant(name, known)}")
            if name in result:
                self.fail(key, f"signals: '{name}' is there twice")
            result[name] = self.raw_of(known[name], value)
        return result

    def raw_of(self, signal, node):
        """Returns the raw value of a number, or of one of a signal's words."""
        words = {str(word): number for number, word in (signal.choices or {}).items()}
        text = target_of(node).value
        if not isinstance(text, str):
            text = ""
        if text in words:
            return words[text]
        value = exact(text)
        if value is None:
            expected = f"a number or one of {', '.join(words)}" if words else "a number"
            self.fail(node, f"{signal.name}: expected {expected}")
        factor, offset = (fractions.Fraction(str(number))
                          for number in (signal.conversion.scale, signal.conversion.offset))
        if not factor:
            self.fail(node, f"{signal.name}: its factor is 0 in the database")
        self.check_limits(signal, node, text, value, (value - offset) / factor)
        raw = (value - offset) / factor
        if not signal.is_float and raw != round(raw):
            warn(f"{signal.name}: {text} is sent as {float(round(raw) * factor + offset):g}: its "
                 f"resolution is {float(factor):g}")
        return float(raw) if signal.is_float else round(raw)

    def check_limits(self, signal, node, text, value, raw):
        limits = [fractions.Fraction(str(limit)) for limit in (signal.minimum, signal.maximum)
                  if limit is not None and math.isfinite(limit)]
        low, high = limits_of(signal)
        unit = f" {signal.unit}" if signal.unit else ""
        if len(limits) == 2 and limits[0] < limits[1] and not limits[0] <= value <= limits[1]:
            self.fail(node, f"{signal.name}: {text} is not "
                            f"{signal.minimum}..{signal.maximum}{unit}")
        if signal.is_float and abs(raw) > FLOAT_MAX.get(signal.length, FLOAT_MAX[64]):
            self.fail(node, f"{signal.name}: {text} is too great for {signal.length} bits")
        if not signal.is_float and not low <= round(raw) <= high:
            least, most = (signal.conversion.raw_to_scaled(end, False) for end in (low, high))
            self.fail(node, f"{signal.name}: {text} is not {least}..{most}{unit}")

    def frame(self, message):
        """Returns the frame: of the variant with all signals that are given."""
        raw = self.raw(message)
        start = beginning(message)
        variant = find_variant(message.signal_tree, raw, start)
        if variant is None:
            self.fail(self.values["signals"], f"signals: {message.name} is multiplexed, and has no "
                                              f"frame with all of these")
        try:
            return frame_text(message, encode(message, variant, {**start, **raw}))
        except Problem as problem:
            return self.fail(self.values["message"], f"message: {problem}")

    def check_single(self, message):
        if not is_single(message):
            self.fail(self.values["message"],
                      f"message: {message.name} ({identifier(message)}) is no single frame")

    def resolved(self, databases, strict):
        """Returns what replaces the entry."""
        message = self.message(databases, strict)
        self.check_single(message)
        parts = [f"send: {self.frame(message)}"]
        if "every" not in self.values:
            if message.cycle_time and message.cycle_time > 0:
                parts.append(f"every: {ms(message.cycle_time)}")
            else:
                line = self.node.start_mark.line + 1
                warn(f"{self.file}:{line}: {plain(message.name)} has no cycle time and is sent "
                     f"once; `every` repeats it")
        parts += [f"{key}: {flow(self.values[key])}" for key in self.values if key in OTHERS]
        return "{ " + ", ".join(parts) + " }"


def find_entries(file, root):
    """Returns the entries of all lists `traffic` that name a database, in the order of the text.
    An entry that aliases repeat is found once."""
    found, seen = {}, set()

    def walk(node, in_traffic):
        node = target_of(node)
        if (id(node), in_traffic) in seen:
            return
        seen.add((id(node), in_traffic))
        names_database = node.id == "mapping" and \
            any(target_of(key).value == "dbc" for key, _ in node.value)
        if in_traffic and names_database:
            found[id(node)] = Entry(file, node)
            return
        for child in node.value if node.id == "sequence" else []:
            walk(child, False)
        for key, value in node.value if node.id == "mapping" else []:
            items = target_of(value)
            if target_of(key).value == "traffic" and items.id == "sequence":
                for item in items.value:
                    walk(item, True)
            else:
                walk(value, False)

    if root is not None:
        walk(root, False)
    return sorted(found.values(), key=lambda entry: entry.node.start_mark.index)


def read_text(file):
    """Returns the text of a file as it is; its lines may end with CR LF."""
    try:
        raw = file.read_bytes()
        return raw.decode("utf-8")
    except OSError as problem:
        raise Problem(f"{file}: {problem.strerror}") from None
    except UnicodeDecodeError as problem:
        line = raw.count(b"\n", 0, problem.start) + 1
        column = problem.start - raw.rfind(b"\n", 0, problem.start)
        raise PlacedProblem(f"{file}:{line}:{column}: this is not UTF-8") from None


def replacements(entries, aliases, strict):
    """Yields begin, end and text of all that is replaced. Anchors in entries go with these, so
    aliases of such anchors give way to what they stand for."""
    databases = {}
    texts = {id(entry.node): entry.resolved(databases, strict) for entry in entries}
    spans = [(entry.node.start_mark.index, end_of(entry.node)) for entry in entries]
    for (begin, end), text in zip(spans, texts.values()):
        yield begin, end, text
    for alias in aliases:
        here, there = alias.start_mark.index, alias.target.start_mark.index
        inside = any(begin <= here < end for begin, end in spans)
        if not inside and any(begin <= there < end for begin, end in spans):
            yield here, alias.end_mark.index, texts.get(id(alias.target)) or flow(alias.target)


def resolve(options):
    """Returns a configuration in which frames stand for messages; all else stays as it is, in its
    line."""
    file = pathlib.Path(options.file)
    text = read_text(file)
    root, aliases = compose(text, file)
    entries = find_entries(file, root)
    if not entries:
        warn(f"{file}: no traffic names a database ('dbc')")
    for begin, end, new in sorted(replacements(entries, aliases, options.strict), reverse=True):
        text = text[:begin] + new + "\n" * text.count("\n", begin, end) + text[end:]
    return text


# ---- Command line --------------------------------------------------------------------------------


def cycle_option(text):
    """Reads TIME or MESSAGE=TIME: a name or None, and a number of ms."""
    name, equals, time = text.rpartition("=")
    found = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)(us|ms|s)", time)
    if not found or not float(found[1]) or (equals and not name):
        raise argparse.ArgumentTypeError(f"'{text}': expected a time such as 100ms, or "
                                         f"MESSAGE=100ms; units are us, ms and s")
    return name or None, fractions.Fraction(found[1]) * UNITS[found[2]]


def arguments(argv):
    parser = argparse.ArgumentParser(
        prog="canwire-restbus", formatter_class=argparse.RawDescriptionHelpFormatter,
        usage="canwire-restbus DATABASE [--without NODE]... [--only NODE]... [options]\n"
              "       canwire-restbus FILE.yaml [--no-strict]",
        description="""\
Writes a configuration of canwire to standard output: of DATABASE the nodes that send, with their
periodic messages, or FILE.yaml with frames in place of the messages that it names.

DATABASE is DBC, ARXML, KCD or SYM. A node of it becomes a node with traffic: each message at its
cycle time with its initial values, a multiplexed one in turn. Messages without a cycle time, or
that are sent at events (GenMsgSendType), are comments, unless --cycle gives them one. Messages
without a sender are left out, unless --sender names one. Standard error tells how many these are.

In FILE.yaml an entry of `traffic` may be { dbc: FILE, message: NAME, signals: { NAME: VALUE } },
with the keys of `send` beside these. Values are physical ones, or words of the database. Signals
that are not named have their initial values. Without `every` the cycle time is the message's.""",
        epilog="exit status: 0, 1 bad input, 2 wrong usage")
    parser.add_argument("file", metavar="FILE", help=argparse.SUPPRESS)
    parser.add_argument("--without", metavar="NODE", action="append", default=[],
                        help="leave out this node: the ECU itself")
    parser.add_argument("--only", metavar="NODE", action="append", default=[],
                        help="only this node; several are allowed")
    parser.add_argument("--cycle", metavar="[MESSAGE=]TIME", action="append", default=[],
                        type=cycle_option, dest="cycle",
                        help="cycle time of this message, or of all that have none: 100ms")
    parser.add_argument("--sender", metavar="NODE",
                        help="this node sends the messages without a sender")
    parser.add_argument("--spread", action="store_true",
                        help="messages without a start delay do not all begin at once")
    parser.add_argument("--no-strict", dest="strict", action="store_false",
                        help="skip the checks of cantools, as for signals that overlap")
    parser.add_argument("--name", help="name of the bus; by default that of the file")
    parser.add_argument("--bitrate", type=int, metavar="N",
                        help="bit rate; by default that of the database, else 500000")
    parser.add_argument("--dbitrate", type=int, metavar="N",
                        help="that of the data phase of CAN FD; by default 2000000")
    options = parser.parse_args(argv)
    if options.name is not None and not re.fullmatch(f"[A-Za-z0-9_.-]{{1,{NAME_MAX}}}",
                                                     options.name):
        parser.error(f"--name: 1 to {NAME_MAX} letters, digits, '_', '.' or '-'")
    if options.bitrate is not None and not 5000 <= options.bitrate <= 1_000_000:
        parser.error(f"--bitrate: expected 5000..1000000, not {options.bitrate}")
    options.cycles = dict(options.cycle)
    if options.file.endswith((".yaml", ".yml")) and (options.without or options.only or
                                                     options.cycles or options.sender or
                                                     options.spread):
        parser.error("--without, --only, --cycle, --sender and --spread are for databases")
    return options


def main(argv=None):
    """Runs the command; returns its exit status."""
    options = arguments(argv)
    logging.basicConfig(format="canwire-restbus: %(message)s")  # of cantools
    try:
        is_yaml = options.file.endswith((".yaml", ".yml"))
        text = resolve(options) if is_yaml else restbus(options)
        sys.stdout.buffer.write(text.encode("utf-8", "surrogateescape"))
        sys.stdout.flush()
    except PlacedProblem as problem:
        print(problem, file=sys.stderr)
        return 1
    except Problem as problem:
        warn(problem)
        return 1
    except BrokenPipeError:  # a reader such as head has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as problem:
        warn(f"standard output: {problem.strerror}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
