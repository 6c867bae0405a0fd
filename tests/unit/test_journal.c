/* SPDX-License-Identifier: MIT
 *
 * test_journal.c - what is done to a bus is written down and run again: the same events, to the
 * byte.
 *
 * The first run is that of a host that does everything that there is at random; it stands for
 * canwired.
 */
#include "record/output.h"
#include "run/bus_make.h"
#include "run/journal.h"
#include "run/journal_check.h"
#include "run/journal_keep.h"
#include "run/journal_play.h"
#include "run/journal_seal.h"

#include <inttypes.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))
#define BIT 160u /* ticks, at 500 kbit/s */
#define PATH_MAX_BYTES 64
#define STEPS 1500u

static char folder[] = "/tmp/test_journal.XXXXXX";

static int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/test_journal.XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
    static const char *const names[] = {"bus.yaml",  "profile.yaml", "journal",
                                        "journal.1", "journal.2",    "journal.3"};
    (void)state;
    for (size_t i = 0; i < COUNT(names); i++) {
        char path[PATH_MAX_BYTES];
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    return rmdir(folder);
}

static const char *path_of(const char *name)
{
    static char paths[4][PATH_MAX_BYTES];
    static unsigned next;
    char *path = paths[next++ % 4];
    snprintf(path, PATH_MAX_BYTES, "%s/%s", folder, name);
    return path;
}

static void write_file(const char *name, const char *text)
{
    FILE *out = fopen(path_of(name), "we");
    assert_non_null(out);
    fputs(text, out);
    assert_int_equal(fclose(out), 0);
}

static char *read_file(const char *name)
{
    FILE *in = fopen(path_of(name), "re");
    char *text = NULL;
    size_t size = 0;
    assert_non_null(in);
    assert_true(getdelim(&text, &size, '\0', in) >= 0);
    fclose(in);
    return text;
}

/* ---- Events as text -------------------------------------------------------------------------- */

typedef struct record {
    char *text;
    size_t size;
    FILE *out;
} record;

static void record_begin(record *r)
{
    *r = (record){.text = NULL};
    r->out = open_memstream(&r->text, &r->size);
    assert_non_null(r->out);
}

static void record_end(record *r)
{
    assert_int_equal(fclose(r->out), 0);
}

/* ---- The first run --------------------------------------------------------------------------- */

typedef struct host {
    uint64_t state; /* of the random numbers */
    live *live;
    void *memory;
    inputs inputs;
    journal *journal;
    record events;
    unsigned rules; /* injected so far, for their names */
    unsigned done[INPUT_COUNT];
} host;

static uint32_t draw(host *h, uint32_t limit)
{
    h->state ^= h->state << 13;
    h->state ^= h->state >> 7;
    h->state ^= h->state << 17;
    return (uint32_t)(h->state >> 32) % limit;
}

static void take_events(void *user)
{
    host *h = user;
    cw_event event;
    while (cw_bus_poll(h->inputs.bus, &event))
        output_event(h->events.out, live_config(h->live), &event);
}

static const char *const configs[] = {
    "bus: { name: test, bitrate: 500000 }\n"
    "seed: 5\n"
    "nodes:\n"
    "  - { name: a, queue: 4 }\n"
    "  - { name: b, restart-ms: 2 }\n"
    "  - { name: c, traffic: [ { reply: 7FF#11 } ] }\n"
    "profiles: [ { file: profile.yaml } ]\n"
    "faults:\n"
    "  - { name: coin, when: { frame: \"100:700\", probability: 0.1 }, "
    "do: { flip: \"crc[3]\", at: b } }\n"
    "  - { name: hand, when: { manual: yes }, do: { bus-off: a } }\n",
    "bus: { name: test, bitrate: 500000 }\n"
    "seed: 5\n"
    "nodes: [ { name: c, order: fifo, queue: 2 }, { name: a, restart-ms: 1 }, { name: d } ]\n"
    "faults:\n"
    "  - { name: hand, when: { manual: yes }, do: { error-flag: c } }\n"
    "  - { name: later, when: { frame: \"123\", every: 5 }, do: { delay: 300us, at: [ a, d ] } }\n",
};

static const char profile_text[] =
    "faults:\n"
    "  - { name: noise, do: { noise: 1e-4 } }\n"
    "  - { name: extend, when: { frame: \"200:700\" }, do: { change: { dlc: 8 } } }\n";

static cfg *load_config(unsigned which)
{
    write_file("bus.yaml", configs[which]);
    write_file("profile.yaml", profile_text);
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    assert_non_null(config);
    return config;
}

static void note_input(void *user, const input *what)
{
    host *h = user;
    h->done[what->kind]++;
    journal_input(h->journal, what);
}

static void host_begin(host *h, uint64_t seed)
{
    char error[JOURNAL_ERROR_MAX];
    *h = (host){.state = seed * 0x9E3779B97F4A7C15u | 1u};
    cfg *config = load_config(0);
    h->live = live_new(config);
    cw_bus *bus = bus_make(&h->memory, config);
    assert_non_null(bus);
    inputs_init(&h->inputs, h->live, bus, take_events, h);
    h->journal = journal_start(path_of("journal"), 2, live_config(h->live), error);
    if (!h->journal)
        fail_msg("%s", error);
    inputs_observe(&h->inputs, note_input, h);
    record_begin(&h->events);
}

/* The files are gone or others by the time the journal is read. */
static void host_end(host *h)
{
    journal_stop(h->journal, &h->inputs);
    record_end(&h->events);
    live_free(h->live);
    free(h->memory);
    write_file("bus.yaml", "gone");
    write_file("profile.yaml", "gone");
}

static unsigned any_node(host *h)
{
    return draw(h, (uint32_t)live_config(h->live)->node_count);
}

/* Mostly good ones; some that no controller can send, or with bytes that do not count. */
static cw_frame any_frame(host *h)
{
    static const uint32_t ids[] = {0x100, 0x123, 0x200, 0x7FF};
    cw_frame frame = {.id = ids[draw(h, COUNT(ids))], .dlc = (uint8_t)draw(h, 9)};
    if (draw(h, 6) == 0)
        frame = (cw_frame){.id = draw(h, 0x1FFFFFFF), .flags = CW_FRAME_EXTENDED, .dlc = frame.dlc};
    if (draw(h, 6) == 0)
        frame.flags |= CW_FRAME_REMOTE;
    if (draw(h, 20) == 0)
        frame.dlc = (uint8_t)draw(h, 256);
    if (draw(h, 40) == 0)
        frame.id = UINT32_MAX;
    if (draw(h, 40) == 0)
        frame.flags = (uint8_t)draw(h, 32);
    bool all = draw(h, 10) == 0;
    for (unsigned i = 0; i < 8 && (i < frame.dlc || all); i++)
        frame.data[i] = (uint8_t)draw(h, 256);
    return frame;
}

/* For now, before or later; in any order. */
static void do_send(host *h)
{
    const uint64_t now = cw_bus_now(h->inputs.bus);
    for (unsigned i = draw(h, 4); i < 4; i++) {
        const cw_frame frame = any_frame(h);
        uint64_t tick = now + draw(h, 1000);
        tick -= tick > 500 ? 500 : tick;
        assert_int_equal(inputs_send(&h->inputs, any_node(h), &frame, tick), CW_OK);
    }
}

static void do_inject(host *h)
{
    static const char *const actions[] = {
        "when: { frame: \"123\", count: 3 }, do: { flip: \"data[0.0]\" }",
        "when: { after: { rule: hand } }, do: { counters: a, tec: 120 }",
        "when: { manual: yes }, do: { bus-off: a }",
        "do: { stuck: recessive, on: a.tx, for: 5ms }",
        "when: { frame: \"100:700\" }, do: { drop: rx, at: c }",
        "when: { nonsense: 1 }, do: { bus-off: a }",
    };
    char text[300];
    char *errors = NULL;
    size_t size;
    FILE *stream = open_memstream(&errors, &size);
    int used = snprintf(text, sizeof text, "- { name: r%u, %s }\n", h->rules, actions[draw(h, 6)]);
    h->rules++;
    snprintf(text + used, sizeof text - (size_t)used, "- { name: r%u, %s }\n", h->rules,
             actions[draw(h, 5)]);
    h->rules++;
    cfg_free_rules(inputs_inject(&h->inputs, text, strlen(text), "test", stream));
    fclose(stream);
    free(errors);
}

/* False when there is none at the place that was drawn. */
static bool any_rule(host *h, unsigned *rule)
{
    const cfg *config = live_config(h->live);
    if (config->rule_count == 0)
        return false;
    *rule = draw(h, (uint32_t)config->rule_count);
    return config->rules[*rule].name != NULL;
}

static void do_rule(host *h)
{
    unsigned rule;
    if (!any_rule(h, &rule))
        return;
    if (draw(h, 3) == 0)
        inputs_clear(&h->inputs, rule);
    else
        (void)inputs_fire(&h->inputs, rule);
}

static void do_set(host *h)
{
    cw_settings s = {.which = (uint8_t)draw(h, 32),
                     .modes_mask = CW_MODE_ONE_SHOT | CW_MODE_LISTEN_ONLY,
                     .modes = draw(h, 3) == 0 ? (uint8_t)draw(h, 4) : 0,
                     .order = (cw_order)draw(h, 2),
                     .queue = (uint16_t)(draw(h, 4) ? 1 + draw(h, 6) : CW_QUEUE_MAX),
                     .warning_limit = (uint16_t)(1 + draw(h, 255)),
                     .restart_ticks = draw(h, 3) * (uint64_t)(CW_CLOCK_HZ / 1000)};
    if (s.which)
        (void)inputs_set(&h->inputs, any_node(h), &s);
}

static void do_skip(host *h)
{
    uint64_t ticks = 1 + draw(h, 1000000);
    const cw_event event = inputs_skip(&h->inputs, ticks, draw(h, 2) ? ticks : 0);
    output_event(h->events.out, live_config(h->live), &event);
}

static void do_reload(host *h)
{
    uint8_t from[CW_NODES_MAX];
    void *memory;
    cfg *config = load_config(draw(h, COUNT(configs)));
    cw_bus *bus = bus_make(&memory, config);
    assert_non_null(bus);
    cfg_match_nodes(from, config, live_config(h->live));
    assert_int_equal(inputs_take_over(&h->inputs, bus, config, from), CW_OK);
    free(h->memory);
    h->memory = memory;
    live_replace(h->live, config);
}

static void do_command(host *h)
{
    switch (draw(h, 8)) {
    case 0:
        do_inject(h);
        break;
    case 1:
    case 2:
        do_rule(h);
        break;
    case 3:
        (void)inputs_restart(&h->inputs, any_node(h));
        break;
    case 4:
        do_set(h);
        break;
    case 5:
        inputs_attach(&h->inputs, any_node(h), draw(h, 3) > 0);
        break;
    case 6:
        do_skip(h);
        break;
    default:
        if (draw(h, 5) == 0)
            do_reload(h);
        break;
    }
}

/* Also to where it is already, and into the middle of bits. */
static void do_advance(host *h)
{
    static const uint32_t spans[] = {1, 10, BIT, 5 * BIT, 200 * BIT, 3000 * BIT};
    inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + draw(h, spans[draw(h, COUNT(spans))]));
}

static void host_run(host *h)
{
    for (unsigned i = 0; i < STEPS; i++) {
        uint32_t what = draw(h, 10);
        if (what < 4)
            do_send(h);
        else if (what < 8)
            do_advance(h);
        else if (what < 9)
            do_command(h);
        else if (draw(h, 5) == 0)
            journal_mark(h->journal, &h->inputs);
    }
    inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + 2000 * BIT);
}

/* ---- The second run -------------------------------------------------------------------------- */

typedef struct listener {
    journal_player *player;
    record events;
    uint64_t bits; /* it may still advance */
} listener;

static void drain(void *user)
{
    const listener *l = user;
    cw_event event;
    while (cw_bus_poll(journal_player_bus(l->player), &event))
        output_event(l->events.out, journal_player_config(l->player), &event);
}

static bool advance(void *user, uint64_t tick)
{
    const listener *l = user;
    while (cw_bus_advance(journal_player_bus(l->player), tick) == CW_FULL)
        drain(user);
    drain(user);
    return true;
}

static void take_event(void *user, const cw_event *event)
{
    const listener *l = user;
    output_event(l->events.out, journal_player_config(l->player), event);
}

static void leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    (void)user;
    (void)next;
    (void)from;
}

static void go_over(void *user)
{
    (void)user;
}

static const journal_calls calls = {
    .advance = advance, .drain = drain, .event = take_event, .leaving = leave, .changed = go_over};

/* Events and messages of a journal; both to be freed. */
static journal_outcome play(char **events, char **messages)
{
    listener l = {.bits = 0};
    journal_outcome outcome = JOURNAL_FAILED;
    record errors;
    record_begin(&errors);
    record_begin(&l.events);
    l.player = journal_player_open(path_of("journal"), &calls, &l, errors.out);
    if (l.player)
        outcome = journal_play(l.player);
    journal_player_close(l.player);
    record_end(&l.events);
    record_end(&errors);
    *events = l.events.text;
    *messages = errors.text;
    return outcome;
}

/* ---- Tests ----------------------------------------------------------------------------------- */

static void check_same(const char *again, const char *first, unsigned seed)
{
    size_t same = 0;
    while (again[same] && again[same] == first[same])
        same++;
    if (again[same] != first[same])
        fail_msg("seed %u: after %zu bytes '%.200s' is not '%.200s'", seed, same, again + same,
                 first + same);
}

static void the_same_inputs_give_the_same_events(void **state)
{
    unsigned done[INPUT_COUNT] = {0};
    (void)state;
    for (unsigned seed = 1; seed <= 30; seed++) {
        host h;
        char *events;
        char *messages;
        host_begin(&h, seed);
        host_run(&h);
        host_end(&h);
        journal_outcome outcome = play(&events, &messages);
        assert_string_equal(messages, "");
        check_same(events, h.events.text, seed);
        assert_int_equal(outcome, JOURNAL_PLAYED);
        assert_true(h.events.size > 1000);
        for (unsigned i = 0; i < INPUT_COUNT; i++)
            done[i] += h.done[i];
        free(h.events.text);
        free(events);
        free(messages);
    }
    for (unsigned i = 0; i < INPUT_COUNT; i++)
        assert_int_not_equal(done[i], 0);
}

/* Up to the last line that is complete, whatever byte it ends at. */
static void a_journal_that_is_cut_off_is_played_as_far_as_it_goes(void **state)
{
    (void)state;
    host h;
    host_begin(&h, 77);
    host_run(&h);
    host_end(&h);
    char *whole = read_file("journal");
    size_t size = strlen(whole);
    size_t first = (size_t)(strchr(strchr(whole, '\n') + 1, '\n') - whole) + 1;
    for (size_t cut = first; cut < size; cut += 1 + size / 150) {
        char *events;
        char *messages;
        assert_int_equal(truncate(path_of("journal"), (off_t)cut), 0);
        assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
        assert_non_null(strstr(messages, "/journal: the journal is cut off at "));
        assert_int_equal(strncmp(events, h.events.text, strlen(events)), 0);
        free(events);
        free(messages);
        write_file("journal", whole); /* for the next cut */
    }
    free(whole);
    free(h.events.text);
}

static void a_journal_that_is_there_is_kept(void **state)
{
    (void)state;
    host h;
    write_file("journal", "of last night\n");
    host_begin(&h, 1);
    host_end(&h);
    char *old = read_file("journal.1");
    assert_string_equal(old, "of last night\n");
    free(old);
    free(h.events.text);
}

static void a_journal_that_cannot_begin_says_why(void **state)
{
    char error[JOURNAL_ERROR_MAX];
    (void)state;
    cfg *config = load_config(0);
    assert_null(journal_start(folder, 2, config, error));
    assert_non_null(strstr(error, "no regular file"));
    assert_null(journal_start("/nowhere/journal", 2, config, error));
    assert_string_equal(error, "journal /nowhere/journal: No such file or directory");
    cfg_free(config);
}

/* ---- Journals that are wrong ----------------------------------------------------------------- */

#define HEADER "{\"canwire-journal\":1,\"canwire\":\"x\"}\n"
#define CONFIG                                                                                     \
    "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":\"{bus: {bitrate: 500000}, nodes: [{name: a}," \
    " {name: b}], faults: [{name: r, when: {manual: yes}, do: {bus-off: a}}]}\"}]}\n"
#define COUNTERS(frames)                                                                           \
    "{\"frames\":" frames ",\"error_frames\":0,\"overload_frames\":0,\"arbitration_lost\":0,"      \
    "\"faults\":0,\"pending\":0}"
#define END "{\"at\":1600,\"end\":" COUNTERS("0") "}\n"

typedef struct bad_journal {
    const char *text;
    const char *message; /* behind the name of the file; a part of it */
} bad_journal;

static const bad_journal bad_journals[] = {
    {"", ":1:1: this is no journal"},
    {"bus: { bitrate: 500000 }\n", ":1:"},
    {"{}\n", ":1:1: this is no journal"},
    {"[]\n", ":1:1: expected an object"},
    {"{\"canwire-journal\":3,\"canwire\":\"x\"}\n",
     ":1:20: version 3 of journals is not known, only 1 to 2"},
    {HEADER, ":2:1: a journal begins with a configuration"},
    {HEADER END, ":2:1: a journal begins with a configuration"},
    {HEADER "{\"at\":0,\"config\":[]}\n", ":2:18: config: expected 1 to 200 files"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\"}]}\n",
     ":2:18: config: expected a list of files"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":\"x: 1\"}]}\n",
     "c:1:1: configuration:"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"c\",\"text\":{\"hex\":\"4\"}}]}\n",
     ":2:18: config: hex: expected pairs"},
    {HEADER "{\"at\":0,\"config\":[{\"name\":\"\",\"text\":\"\"}]}\n",
     ":2:18: config: expected a text that is not empty"},
    {HEADER CONFIG "\n", ":3:"},
    {HEADER CONFIG "{\"at\":0\n", ":3:7: "},
    {HEADER CONFIG "{\"at\":0,\"at\":0}\n", ":3:12: duplicate object key"},
    {HEADER CONFIG "{\"send\":\"a\"}\n", ":3:1: the key 'at' is missing"},
    {HEADER CONFIG "{\"at\":-160,\"fire\":\"r\"}\n", ":3:7: at: expected a whole number"},
    {HEADER CONFIG "{\"at\":1.5,\"fire\":\"r\"}\n", ":3:7: at: expected a whole number"},
    {HEADER CONFIG "{\"at\":161,\"fire\":\"r\"}\n", ":3:7: at: not the end of a bit"},
    {HEADER CONFIG "{\"at\":160,\"skip\":1,\"earlier\":0}\n{\"at\":0,\"skip\":1,\"earlier\":1}\n",
     ":4:7: at: before the line above"},
    {HEADER CONFIG "{\"at\":0}\n", ":3:1: this is no line of a journal"},
    {HEADER CONFIG "{\"at\":0,\"sned\":\"a\"}\n",
     ":3:16: this is no line of a journal (did you mean 'send'?)"},
    {HEADER CONFIG "{\"at\":0,\"fire\":1}\n", ":3:16: fire: expected a text"},
    {HEADER CONFIG "{\"at\":0,\"fire\":\"x\"}\n", ":3:16: there is no rule 'x'"},
    {HEADER CONFIG "{\"at\":0,\"clear\":\"x\"}\n", ":3:17: there is no rule 'x'"},
    {HEADER CONFIG "{\"at\":0,\"fire\":\"r\",\"why\":1}\n", ":3:26: fire: there is no key 'why'"},
    {HEADER CONFIG "{\"at\":0,\"again\":false,\"fire\":\"r\"}\n", ":3:17: again: expected true"},
    {HEADER "{\"at\":0,\"again\":true,\"config\":[]}\n", ":2:17: config: there is no key 'again'"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"z\",\"frame\":\"123#\",\"tick\":0}\n",
     ":3:16: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"frame\":\"123#\"}\n",
     ":3:1: send: the key 'tick' is missing"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"frame\":\"12#\",\"tick\":0}\n", ":3:28: frame: "},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"tick\":0}\n", ":3:1: send: expected either frame"},
    {HEADER CONFIG "{\"at\":0,\"send\":\"a\",\"tick\":0,\"frame\":\"123#\",\"id\":1}\n",
     ":3:37: send: expected either frame"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":32,\"dlc\":0,\"data\":\"\"}\n",
     ":3:44: flags: expected a whole number from 0 to 31"},
    {HEADER CONFIG
     "{\"at\":0,\"send\":\"a\",\"tick\":0,\"id\":1,\"flags\":0,\"dlc\":0,\"data\":\"00\"}\n",
     ":3:61: data: expected 8 bytes"},
    {HEADER CONFIG "{\"at\":0,\"set\":\"a\",\"settings\":{\"queue\":0}}\n",
     ":3:30: settings: queue: "},
    {HEADER CONFIG "{\"at\":0,\"set\":\"a\"}\n", ":3:1: set: the key 'settings' is missing"},
    {HEADER CONFIG "{\"at\":0,\"attach\":\"z\"}\n", ":3:18: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"detach\":\"z\"}\n", ":3:18: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"restart\":\"z\"}\n", ":3:19: there is no node 'z'"},
    {HEADER CONFIG "{\"at\":0,\"inject\":7,\"name\":\"x\"}\n", ":3:18: inject: expected a text or"},
    {HEADER CONFIG "{\"at\":0,\"reload\":[{\"name\":\"c\",\"text\":\"\"}]}\n",
     "c:1:1: the file is empty"},
    {HEADER CONFIG "{\"at\":0,\"reload\":[{\"name\":\"c\",\"text\":\"{bus: {bitrate: 250000},"
                   " nodes: [{name: a}]}\"}]}\n",
     ":3:18: the bus cannot go over to it"},
    {HEADER CONFIG CONFIG, ":3:18: there is a second configuration"},
    {HEADER CONFIG "{\"at\":0,\"mark\":{}}\n", ":3:16: mark: expected a whole number at 'frames'"},
    /* another run */
    {HEADER CONFIG "{\"at\":0,\"restart\":\"a\"}\n" END,
     ":3:19: this run is another one than that of the journal: the bus refuses what it did then; "
     "it was written by canwire x\n"},
    {HEADER CONFIG "{\"at\":0,\"inject\":\"nonsense\",\"name\":\"x\"}\n" END,
     ":3:18: this run is another one than that of the journal: the bus does not take these rules"},
    {HEADER CONFIG "{\"at\":1600,\"mark\":" COUNTERS("1") "}\n" END,
     ":3:19: this run is another one than that of the journal: frames is 0 and was 1"},
};

static void bad_journals_are_refused_with_their_place(void **state)
{
    (void)state;
    for (size_t i = 0; i < COUNT(bad_journals); i++) {
        const bad_journal *bad = &bad_journals[i];
        char *events;
        char *messages;
        write_file("journal", bad->text);
        journal_outcome outcome = play(&events, &messages);
        const char *said = messages;
        if (bad->message[0] == ':' && strncmp(said, path_of("journal"), strlen(path_of(""))) == 0)
            said += strlen(path_of("journal"));
        if (outcome != JOURNAL_FAILED || strncmp(said, bad->message, strlen(bad->message)) != 0)
            fail_msg("%s\nexpected %s\ngot %d %s", bad->text, bad->message, (int)outcome, messages);
        free(events);
        free(messages);
    }
}

static void a_broken_journal_says_so(void **state)
{
    char *events;
    char *messages;
    (void)state;
    write_file("journal",
               HEADER CONFIG "{\"at\":0,\"fire\":\"r\"}\n{\"at\":1600,\"broken\":true}\n");
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "the journal is broken at 0.000020000 s (line 4, byte "));
    assert_non_null(strstr(events, "\"state\":\"bus-off\""));
    free(events);
    free(messages);
}

/* ---- Damage ---------------------------------------------------------------------------------- */

/* What `canwire check --journal` says of a text. */
static bool check_text(const char *text, size_t size, char **messages)
{
    record errors;
    FILE *out = fopen(path_of("journal"), "we");
    FILE *nowhere = fopen("/dev/null", "we");
    assert_non_null(out);
    assert_int_equal(fwrite(text, 1, size, out), size);
    fclose(out);
    record_begin(&errors);
    bool good = journal_check(path_of("journal"), nowhere, errors.out);
    record_end(&errors);
    fclose(nowhere);
    *messages = errors.text;
    return good;
}

/* A small journal with lines of all kinds that there are in one. */
static char *make_small_journal(size_t *size)
{
    const cw_frame frame = {.id = 0x123, .dlc = 2, .data = {1, 2}};
    host h;
    host_begin(&h, 1);
    (void)inputs_send(&h.inputs, 0, &frame, 0);
    inputs_advance(&h.inputs, 300 * BIT);
    journal_mark(h.journal, &h.inputs);
    inputs_advance(&h.inputs, 400 * BIT);
    host_end(&h);
    free(h.events.text);
    char *text = read_file("journal");
    *size = strlen(text);
    return text;
}

/* "journal:LINE:", or a message without place. */
static void check_place(const char *messages, const char *text, size_t damaged)
{
    size_t line = 1;
    for (size_t i = 0; i < damaged; i++)
        line += text[i] == '\n';
    const char *said = strstr(messages, path_of("journal"));
    assert_non_null(said);
    size_t told = strtoul(said + strlen(path_of("journal")) + 1, NULL, 10);
    if (told != line)
        fail_msg("byte %zu of line %zu: %s", damaged, line, messages);
}

/* One bit of each byte, another from byte to byte. */
static void a_flipped_bit_of_each_byte_is_found_with_its_line(void **state)
{
    size_t size;
    char *messages;
    (void)state;
    char *text = make_small_journal(&size);
    assert_true(check_text(text, size, &messages));
    assert_string_equal(messages, "");
    free(messages);
    for (size_t i = 0; i < size; i++) {
        const unsigned bit = i % 8;
        text[i] = (char)(text[i] ^ 1 << bit);
        if (check_text(text, size, &messages))
            fail_msg("bit %u of byte %zu", bit, i);
        text[i] = (char)(text[i] ^ 1 << bit);
        check_place(messages, text, i);
        free(messages);
    }
    free(text);
}

static void each_cut_is_found(void **state)
{
    size_t size;
    char *messages;
    (void)state;
    char *text = make_small_journal(&size);
    for (size_t i = 0; i < size; i++) {
        if (check_text(text, i, &messages))
            fail_msg("cut at byte %zu", i);
        check_place(messages, text, i);
        free(messages);
    }
    free(text);
}

/* Whole lines can be lost, too, and come again. */
static void each_missing_or_repeated_line_is_found(void **state)
{
    size_t size;
    char *messages;
    (void)state;
    char *text = make_small_journal(&size);
    char *other = malloc(2 * size);
    unsigned lines = 0;
    for (size_t i = 0; i < size; lines++) {
        size_t length = (size_t)(strchr(text + i, '\n') - text) + 1 - i;
        memcpy(other, text, i);
        memcpy(other + i, text + i + length, size - i - length);
        assert_false(check_text(other, size - length, &messages));
        assert_string_not_equal(messages, "");
        free(messages);
        memcpy(other, text, i + length);
        memcpy(other + i + length, text + i, size - i);
        assert_false(check_text(other, size + length, &messages));
        assert_string_not_equal(messages, "");
        free(messages);
        i += length;
    }
    assert_int_equal(lines, 5);
    free(other);
    free(text);
}

static void a_damaged_journal_is_played_up_to_the_damage(void **state)
{
    size_t size;
    char *events;
    char *messages;
    (void)state;
    char *text = make_small_journal(&size);
    *strstr(text, "\"end\"") ^= 1;
    write_file("journal", text);
    assert_int_equal(play(&events, &messages), JOURNAL_FAILED);
    assert_non_null(strstr(messages, ":5:1: damaged: wrong checksum, bytes "));
    assert_non_null(strstr(messages, " of the file, behind 0.000600000 s"));
    assert_string_not_equal(events, "");
    free(events);
    free(messages);
    free(text);
}

static void the_checksum_is_that_of_zlib(void **state)
{
    (void)state;
    assert_int_equal(journal_crc32(0, "123456789", 9), 0xCBF43926);
    assert_int_equal(journal_crc32(journal_crc32(0, "1234", 4), "56789", 5), 0xCBF43926);
}

/* ---- The journals of before ------------------------------------------------------------------ */

static void write_numbered(unsigned number, const char *text)
{
    char name[32];
    snprintf(name, sizeof name, number ? "journal.%u" : "journal", number);
    if (text)
        write_file(name, text);
    else
        unlink(path_of(name));
}

/* Letters: a journal of that name, small ones with their end; '-': none. */
typedef struct keeping {
    unsigned files;
    const char *before; /* from FILE on */
    const char *after;  /* from FILE.1 on */
} keeping;

static const keeping keepings[] = {
    {5, "A---", "A---"},  {5, "AB--", "AB--"}, {2, "a---", "a---"}, {2, "ab--", "a---"},
    {3, "abc-", "ab--"},  {3, "AbC-", "AC--"}, {3, "aBC-", "aC--"}, {3, "ABC-", "AC--"},
    {3, "ABCD", "A-D-"},  {2, "A---", "A---"}, {2, "AB--", "AB--"}, {2, "ABC-", "AC--"},
    {4, "aBc-", "aBc-"},  {4, "A-BC", "ABC-"}, {4, "-BC-", "BC--"}, {4, "abCD", "aCD-"},
    {3, "----", "----"},
};

static void the_first_without_end_and_the_newest_are_kept(void **state)
{
    (void)state;
    for (size_t k = 0; k < COUNT(keepings); k++) {
        const keeping *now = &keepings[k];
        char after[5] = "----";
        for (unsigned i = 0; i < 4; i++) {
            char text[200];
            snprintf(text, sizeof text,
                     "{\"canwire-journal\":1,\"canwire\":\"x\",\"bus\":\"%c\"}\n%s",
                     now->before[i],
                     now->before[i] >= 'a' ? END : "{\"at\":0,\"fire\":\"r\"}\n");
            write_numbered(i, now->before[i] == '-' ? NULL : text);
        }
        assert_int_equal(journal_make_room(path_of("journal"), now->files), 0);
        assert_int_equal(access(path_of("journal"), F_OK), -1);
        for (unsigned i = 0; i < 4; i++) {
            char name[32];
            snprintf(name, sizeof name, "journal.%u", i + 1);
            if (access(path_of(name), F_OK) != 0)
                continue;
            char *text = read_file(name);
            after[i] = strstr(text, "\"bus\":\"")[7];
            free(text);
        }
        if (strcmp(after, now->after) != 0)
            fail_msg("%u files, %s: %s and not %s", now->files, now->before, after, now->after);
        for (unsigned i = 0; i < 5; i++)
            write_numbered(i, NULL);
    }
}

static void in_a_loop_of_crashes_the_first_is_kept_and_the_disk_bounded(void **state)
{
    (void)state;
    for (unsigned i = 0; i < 1000; i++) {
        char text[200];
        assert_int_equal(journal_make_room(path_of("journal"), 3), 0);
        snprintf(text, sizeof text,
                 "{\"canwire-journal\":1,\"canwire\":\"x\",\"bus\":\"%u\"}\n", i);
        write_file("journal", text);
        assert_int_equal(access(path_of("journal.3"), F_OK), -1);
    }
    char *first = read_file("journal.2");
    char *last = read_file("journal.1");
    assert_non_null(strstr(first, "\"bus\":\"0\""));
    assert_non_null(strstr(last, "\"bus\":\"998\""));
    free(first);
    free(last);
    for (unsigned i = 0; i < 3; i++)
        write_numbered(i, NULL);
}

static void a_good_journal_has_nothing_to_say(void **state)
{
    char *events;
    char *messages;
    (void)state;
    write_file("journal", HEADER CONFIG END);
    assert_int_equal(play(&events, &messages), JOURNAL_PLAYED);
    assert_string_equal(messages, "");
    assert_string_equal(events, "");
    free(events);
    free(messages);
}

/* ---- Trouble --------------------------------------------------------------------------------- */

/* In a process of its own: the limit is for good. */
static int journal_without_room(void)
{
    char error[JOURNAL_ERROR_MAX];
    const struct rlimit limit = {.rlim_cur = 4000, .rlim_max = 4000};
    const cw_frame frame = {.id = 0x123};
    host h;
    host_begin(&h, 1);
    if (!freopen("/dev/null", "we", stderr) || setrlimit(RLIMIT_FSIZE, &limit) != 0)
        return 2; /* what is logged may go to a file that is larger already */
    unlink(path_of("journal"));
    journal *full = journal_start(path_of("journal"), 2, live_config(h.live), error);
    inputs_observe(&h.inputs, journal_input, full);
    for (unsigned i = 0; i < 100000 && journal_lost(full) == 0; i++) {
        (void)inputs_send(&h.inputs, 0, &frame, 0);
        inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 100 * BIT);
        if (i % 100 == 99)
            usleep(1000);
        journal_mark(full, &h.inputs);
    }
    uint64_t lost = journal_lost(full);
    for (unsigned i = 0; i < 10; i++)
        (void)inputs_send(&h.inputs, 0, &frame, 0);
    return lost == 0 || journal_lost(full) != lost + 10;
}

static void a_full_disk_breaks_a_journal(void **state)
{
    char *events;
    char *messages;
    int status;
    (void)state;
    fflush(stdout);
    pid_t child = fork();
    if (child == 0)
        _exit(journal_without_room());
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "/journal: the journal is cut off at 0.0"));
    assert_non_null(strstr(events, "\"event\":\"tx\""));
    free(events);
    free(messages);
}

/* Until a broken journal is seen to be written again. */
static bool wait_for_state(journal *j, host *h, const char *wanted)
{
    for (unsigned i = 0; i < 60000; i++) {
        json_t *status = journal_to_json(j);
        bool is = strcmp(json_string_value(json_object_get(status, "state")), wanted) == 0;
        json_decref(status);
        if (is)
            return true;
        inputs_advance(&h->inputs, cw_bus_now(h->inputs.bus) + 100 * BIT);
        journal_mark(j, &h->inputs);
        usleep(1000);
    }
    return false;
}

/* Whether what is broken says so from the last line on that is in the file. */
static bool tells_where_it_breaks(const journal *j)
{
    struct stat there;
    bool empty = stat(path_of("journal"), &there) == 0 && there.st_size == 0;
    char *text = empty ? NULL : read_file("journal");
    json_t *status = journal_to_json(j);
    const uint64_t told_ns =
        (uint64_t)json_integer_value(json_object_get(status, "broken_ns"));
    uint64_t last = 0;
    for (const char *line = text; line; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, "{\"at\":", 6) == 0)
            last = strtoull(line + 6, NULL, 10);
    }
    json_decref(status);
    free(text);
    return told_ns == last * 25 / 2;
}

/* In a process of its own: it gets room for more when it has had too little. */
static int journal_with_room_again(bool by_itself, rlim_t room)
{
    char error[JOURNAL_ERROR_MAX];
    struct rlimit limit = {.rlim_cur = room, .rlim_max = RLIM_INFINITY};
    const cw_frame frame = {.id = 0x123};
    host h;
    host_begin(&h, 1);
    if (!freopen("/dev/null", "we", stderr) || setrlimit(RLIMIT_FSIZE, &limit) != 0)
        return 2;
    for (unsigned i = 0; i < 4; i++)
        write_numbered(i, NULL);
    journal *full = journal_start(path_of("journal"), 2, live_config(h.live), error);
    inputs_observe(&h.inputs, journal_input, full);
    for (unsigned i = 0; i < 1000; i++) {
        (void)inputs_send(&h.inputs, 0, &frame, 0);
        inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 200 * BIT);
    }
    if (!wait_for_state(full, &h, "broken"))
        return 3;
    if (!tells_where_it_breaks(full))
        return 5;
    (void)inputs_send(&h.inputs, 1, &frame, 0);
    limit.rlim_cur = RLIM_INFINITY;
    (void)setrlimit(RLIMIT_FSIZE, &limit);
    if (!by_itself)
        journal_retry(full, &h.inputs);
    if (!wait_for_state(full, &h, "writing"))
        return 4;
    const cw_frame last = {.id = 0x7FF};
    (void)inputs_send(&h.inputs, 1, &last, 0);
    inputs_advance(&h.inputs, cw_bus_now(h.inputs.bus) + 300 * BIT);
    journal_stop(full, &h.inputs);
    return 0;
}

/* Bytes at first: for some lines, for the header alone, for nothing. */
static const rlim_t rooms[] = {4000, 200, 100};

static void a_journal_is_taken_up_again(void **state)
{
    (void)state;
    for (unsigned i = 0; i < 6; i++) {
        char *events;
        char *messages;
        int status;
        fflush(stdout);
        pid_t child = fork();
        if (child == 0)
            _exit(journal_with_room_again(i % 2 == 0, rooms[i / 2]));
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_int_equal(status, 0);
        assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
        assert_non_null(strstr(messages, "nothing was written from 0.0"));
        assert_non_null(strstr(messages, "(File too large), "));
        assert_null(strstr(messages, ", 0 lines"));
        free(events);
        free(messages);
        char *text = read_file("journal");
        assert_non_null(strstr(text, "\"frame\":\"7FF#\""));
        assert_non_null(strstr(text, "\"nodes\":[{\"name\":\"a\",\"state\":\"error-active\""));
        assert_false(check_text(text, strlen(text), &messages));
        assert_non_null(strstr(messages, "nothing was written from 0.0"));
        assert_int_equal(strchr(messages, '\n')[1], 0); /* nothing else is wrong */
        free(messages);
        free(text);
    }
}

/* It says where it is broken, and ends there. */
static void too_much_at_once_breaks_a_journal(void **state)
{
    enum { SIZE = 9 << 20 };
    char *text = malloc(SIZE);
    char *events;
    char *messages;
    (void)state;
    memset(text, ' ', SIZE);
    host h;
    host_begin(&h, 1);
    inputs_advance(&h.inputs, 100 * BIT);
    const input large = {
        .kind = INPUT_INJECT, .now = 100 * BIT, .text = text, .size = SIZE, .name = "x"};
    journal_input(h.journal, &large);
    const cw_frame frame = {.id = 0x123};
    assert_int_equal(inputs_send(&h.inputs, 0, &frame, 0), CW_OK);
    inputs_advance(&h.inputs, 1000 * BIT);
    assert_int_equal(journal_lost(h.journal), 2);
    journal_mark(h.journal, &h.inputs);
    host_end(&h);
    assert_int_equal(play(&events, &messages), JOURNAL_INCOMPLETE);
    assert_non_null(strstr(messages, "nothing was written from 0.000000000 s to 0.002000000 s (the "
                                     "disk is too slow), 2 lines are missing"));
    assert_string_equal(events, "");
    free(text);
    free(events);
    free(messages);
    free(h.events.text);
}

/* The largest that a configuration can be. */
static void a_large_configuration_goes_into_it(void **state)
{
    enum { SIZE = 4000000 };
    char *text = malloc(SIZE + 1);
    char error[JOURNAL_ERROR_MAX];
    char *events;
    char *messages;
    (void)state;
    memset(text, '\n', SIZE);
    memcpy(text, configs[1], strlen(configs[1]));
    text[SIZE] = '\0';
    write_file("bus.yaml", text);
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    live *l = live_new(config);
    void *memory;
    inputs in;
    inputs_init(&in, l, bus_make(&memory, config), NULL, NULL);
    journal *j = journal_start(path_of("journal"), 2, live_config(l), error);
    assert_int_equal(journal_lost(j), 0);
    journal_stop(j, &in);
    assert_int_equal(play(&events, &messages), JOURNAL_PLAYED);
    assert_string_equal(messages, "");
    live_free(l);
    free(memory);
    free(text);
    free(events);
    free(messages);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_inputs_give_the_same_events),
        cmocka_unit_test(a_journal_that_is_cut_off_is_played_as_far_as_it_goes),
        cmocka_unit_test(a_journal_that_is_there_is_kept),
        cmocka_unit_test(a_journal_that_cannot_begin_says_why),
        cmocka_unit_test(bad_journals_are_refused_with_their_place),
        cmocka_unit_test(a_broken_journal_says_so),
        cmocka_unit_test(a_flipped_bit_of_each_byte_is_found_with_its_line),
        cmocka_unit_test(each_cut_is_found),
        cmocka_unit_test(each_missing_or_repeated_line_is_found),
        cmocka_unit_test(a_damaged_journal_is_played_up_to_the_damage),
        cmocka_unit_test(the_checksum_is_that_of_zlib),
        cmocka_unit_test(the_first_without_end_and_the_newest_are_kept),
        cmocka_unit_test(in_a_loop_of_crashes_the_first_is_kept_and_the_disk_bounded),
        cmocka_unit_test(a_journal_is_taken_up_again),
        cmocka_unit_test(a_good_journal_has_nothing_to_say),
        cmocka_unit_test(a_full_disk_breaks_a_journal),
        cmocka_unit_test(too_much_at_once_breaks_a_journal),
        cmocka_unit_test(a_large_configuration_goes_into_it),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
