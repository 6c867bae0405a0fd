/* SPDX-License-Identifier: MIT
 *
 * journal_rig.h - a host that keeps a journal, for unit tests: in a folder of its own; and the
 * journal run again.
 */
#ifndef CANWIRE_TEST_JOURNAL_RIG_H
#define CANWIRE_TEST_JOURNAL_RIG_H

#include "cases.h"
#include "record/output.h"
#include "run/bus_make.h"
#include "run/inputs.h"
#include "run/journal.h"
#include "run/journal_check.h"
#include "run/journal_pack.h"
#include "run/journal_play.h"
#include "run/live.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#define BIT 160u /* ticks, at 500 kbit/s */
#define PATH_MAX_BYTES 64
#define SMALL_SENDS 3u /* frames in a small journal */

static char folder[] = "/tmp/test_journal.XXXXXX";

static inline int make_folder(void **state)
{
    (void)state;
    strcpy(folder, "/tmp/test_journal.XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static inline int remove_folder(void **state)
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

static inline const char *path_of(const char *name)
{
    static char paths[4][PATH_MAX_BYTES];
    static unsigned next;
    char *path = paths[next++ % 4];
    snprintf(path, PATH_MAX_BYTES, "%s/%s", folder, name);
    return path;
}

static inline void write_file(const char *name, const char *text)
{
    FILE *out = fopen(path_of(name), "we");
    assert_non_null(out);
    fputs(text, out);
    assert_int_equal(fclose(out), 0);
}

static inline void write_bytes(const char *name, const char *bytes, size_t size)
{
    FILE *out = fopen(path_of(name), "we");
    assert_non_null(out);
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    assert_int_equal(fclose(out), 0);
}

/* Returns the bytes of a file, with a 0 behind them. */
static inline char *read_bytes(const char *name, size_t *size)
{
    struct stat there;
    FILE *in = fopen(path_of(name), "re");
    assert_non_null(in);
    assert_int_equal(fstat(fileno(in), &there), 0);
    *size = (size_t)there.st_size;
    char *bytes = calloc(1, *size + 1);
    assert_non_null(bytes);
    assert_int_equal(fread(bytes, 1, *size, in), *size);
    fclose(in);
    return bytes;
}

static inline char *read_file(const char *name)
{
    size_t size;
    return read_bytes(name, &size);
}

/* Returns the text of a journal, which is packed, as far as it can be read. */
static inline char *read_text_of(const char *name, bool *whole)
{
    enum { CHUNK = 4096 };
    const char *problem;
    bool damaged;
    size_t size = 0;
    ssize_t count = 1;
    char *text = malloc(CHUNK + 1);
    int fd = open(path_of(name), O_RDONLY | O_CLOEXEC);
    journal_unpacker *u = journal_unpack(fd);
    assert_non_null(u);
    while (count > 0) {
        count = journal_unpack_read(u, text + size, CHUNK, &problem, &damaged);
        size += count > 0 ? (size_t)count : 0;
        text = realloc(text, size + CHUNK + 1);
        assert_non_null(text);
    }
    text[size] = '\0';
    *whole = count == 0;
    journal_unpack_end(u);
    close(fd);
    return text;
}

static inline char *read_text(const char *name)
{
    bool whole;
    return read_text_of(name, &whole);
}

/* ---- Events as text -------------------------------------------------------------------------- */

typedef struct record {
    char *text;
    size_t size;
    FILE *out;
} record;

static inline void record_begin(record *r)
{
    *r = (record){.text = NULL};
    r->out = open_memstream(&r->text, &r->size);
    assert_non_null(r->out);
}

static inline void record_end(record *r)
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

static inline void take_events(void *user)
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

static inline cfg *load_config(unsigned which)
{
    write_file("bus.yaml", configs[which]);
    write_file("profile.yaml", profile_text);
    cfg *config = cfg_load(path_of("bus.yaml"), stderr);
    assert_non_null(config);
    return config;
}

static inline void note_input(void *user, const input *what)
{
    host *h = user;
    h->done[what->kind]++;
    journal_input(h->journal, what);
}

/* Begins the run of a configuration, which is the host's. */
static inline void host_begin_with(host *h, cfg *config)
{
    char error[JOURNAL_ERROR_MAX];
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

static inline void host_begin(host *h, uint64_t seed)
{
    *h = (host){.state = seed * 0x9E3779B97F4A7C15u | 1u};
    host_begin_with(h, load_config(0));
}

/* Ends a host; its files have gone or changed when the journal is read. */
static inline void host_end(host *h)
{
    journal_stop(h->journal, &h->inputs);
    record_end(&h->events);
    live_free(h->live);
    free(h->memory);
    write_file("bus.yaml", "gone");
    write_file("profile.yaml", "gone");
}

/* ---- The second run -------------------------------------------------------------------------- */

typedef struct listener {
    journal_player *player;
    record events;
    uint64_t bits; /* it may still advance */
} listener;

static inline void drain(void *user)
{
    const listener *l = user;
    cw_event event;
    while (cw_bus_poll(journal_player_bus(l->player), &event))
        output_event(l->events.out, journal_player_config(l->player), &event);
}

static inline bool advance(void *user, uint64_t tick)
{
    const listener *l = user;
    while (cw_bus_advance(journal_player_bus(l->player), tick) == CW_FULL)
        drain(user);
    drain(user);
    return true;
}

static inline void take_event(void *user, const cw_event *event)
{
    const listener *l = user;
    output_event(l->events.out, journal_player_config(l->player), event);
}

static inline void leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    (void)user;
    (void)next;
    (void)from;
}

static inline void go_over(void *user)
{
    (void)user;
}

static const journal_calls calls = {
    .advance = advance, .drain = drain, .event = take_event, .leaving = leave, .changed = go_over};

/* Events and messages of a journal; both to be freed. */
static inline journal_outcome play(char **events, char **messages)
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

/* ---- Journals that are wrong ----------------------------------------------------------------- */

#define COUNTERS(frames)                                                                           \
    "{\"frames\":" frames ",\"error_frames\":0,\"overload_frames\":0,\"arbitration_lost\":0,"      \
    "\"faults\":0,\"pending\":0}"
#define END "{\"at\":1600,\"end\":" COUNTERS("0") "}\n"

/* ---- Damage ---------------------------------------------------------------------------------- */

/* Takes the messages of `canwire check --journal` about a text. */
static inline bool check_text(const char *text, size_t size, char **messages)
{
    record errors;
    FILE *nowhere = fopen("/dev/null", "we");
    write_bytes("journal", text, size);
    record_begin(&errors);
    bool good = journal_check(path_of("journal"), nowhere, errors.out);
    record_end(&errors);
    fclose(nowhere);
    *messages = errors.text;
    return good;
}

/* Makes a small journal, and returns its text. */
static inline char *make_small_journal(size_t *size)
{
    const cw_frame frame = {.id = 0x123, .dlc = 2, .data = {1, 2}};
    host h;
    host_begin(&h, 1);
    for (unsigned i = 0; i < SMALL_SENDS; i++)
        (void)inputs_send(&h.inputs, 0, &frame, i);
    inputs_advance(&h.inputs, 300 * BIT);
    journal_mark(h.journal, &h.inputs);
    inputs_advance(&h.inputs, 400 * BIT);
    host_end(&h);
    free(h.events.text);
    char *text = read_text("journal");
    *size = strlen(text);
    return text;
}

/* ---- The journals of before ------------------------------------------------------------------ */

static inline void write_packed(const char *name, const char *text)
{
    spool_packer packer;
    size_t size;
    FILE *out = fopen(path_of(name), "we");
    assert_non_null(out);
    assert_true(journal_packer(&packer, false));
    const void *bytes = packer.pack(packer.user, &size, text, strlen(text));
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    bytes = packer.end(packer.user, &size);
    assert_int_equal(fwrite(bytes, 1, size, out), size);
    packer.free(packer.user);
    assert_int_equal(fclose(out), 0);
}

static inline void write_numbered(unsigned number, const char *text, bool packed)
{
    char name[32];
    snprintf(name, sizeof name, number ? "journal.%u" : "journal", number);
    if (!text)
        unlink(path_of(name));
    else if (packed)
        write_packed(name, text);
    else
        write_file(name, text);
}

#endif
