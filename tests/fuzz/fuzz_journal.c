/* SPDX-License-Identifier: MIT
 *
 * fuzz_journal.c - files that are journals, or nearly; and the runs that come of them.
 *
 * Each is played with every bit simulated and with short cuts, and a text also packed: the events
 * must be the same.
 */
#include "fuzz.h"

#include "record/output.h"
#include "run/journal_pack.h"
#include "run/journal_play.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define BITS 20000u  /* of a run */
#define WORK 160000u /* nodes times bits */
#define PIECE 100u   /* bytes that are packed at once */
#define MAGIC 0x28   /* the first byte of what is packed */

typedef struct run {
    journal_player *player;
    uint64_t bits_left;
    char *text; /* events as they are written */
    size_t size;
    FILE *out;
} run;

static void take(run *r, const cw_event *event)
{
    const cfg *config = journal_player_config(r->player);
    REQUIRE(config->node_count == CW_NODES_MAX || event->nodes >> config->node_count == 0);
    REQUIRE(event->kind != CW_EVENT_FAULT || event->rule < config->rule_count);
    output_event(r->out, config, event);
}

static void drain(void *user)
{
    run *r = user;
    cw_event event;
    while (cw_bus_poll(journal_player_bus(r->player), &event))
        take(r, &event);
}

static bool advance(void *user, uint64_t tick)
{
    run *r = user;
    const cfg *config = journal_player_config(r->player);
    cw_bus *bus = journal_player_bus(r->player);
    uint64_t bits = 1 + cw_rate_bits(config->rate, tick - cw_bus_now(bus));
    REQUIRE(tick >= cw_bus_now(bus));
    if (bits > r->bits_left || bits * config->node_count > WORK)
        return false;
    r->bits_left -= bits;
    while (cw_bus_advance(bus, tick) == CW_FULL)
        drain(r);
    drain(r);
    REQUIRE(cw_bus_now(bus) <= tick);
    return true;
}

static void take_event(void *user, const cw_event *event)
{
    take(user, event);
}

static void leave(void *user, const cfg *next, const uint8_t from[CW_NODES_MAX])
{
    const run *r = user;
    for (unsigned i = 0; i < next->node_count; i++)
        REQUIRE(from[i] == CW_NO_NODE || from[i] < journal_player_config(r->player)->node_count);
}

static void go_over(void *user)
{
    (void)user;
}

static journal_outcome play(run *r, const char *path, bool stepping, FILE *errors)
{
    static const journal_calls calls = {.advance = advance,
                                        .drain = drain,
                                        .event = take_event,
                                        .leaving = leave,
                                        .changed = go_over};
    journal_outcome outcome = JOURNAL_FAILED;
    *r = (run){.bits_left = BITS};
    r->out = open_memstream(&r->text, &r->size);
    REQUIRE(r->out != NULL);
    r->player = journal_player_open(path, &calls, r, errors);
    if (r->player) {
        cw_bus_set_stepping(journal_player_bus(r->player), stepping);
        outcome = journal_play(r->player);
    }
    journal_player_close(r->player);
    REQUIRE(fclose(r->out) == 0);
    return outcome;
}

/* Plays a journal with its messages; each problem has one. */
static journal_outcome play_aloud(run *r, const char *path, bool stepping)
{
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    REQUIRE(errors != NULL);
    journal_outcome outcome = play(r, path, stepping, errors);
    REQUIRE(fclose(errors) == 0);
    REQUIRE((outcome == JOURNAL_PLAYED || outcome == JOURNAL_STOPPED) == (length == 0));
    REQUIRE(length == 0 || messages[length - 1] == '\n');
    free(messages);
    return outcome;
}

/* Returns a file of the program's own with bytes. */
static int make_file(const void *data, size_t size)
{
    int fd = memfd_create("journal", MFD_CLOEXEC);
    REQUIRE(fd >= 0);
    REQUIRE(write(fd, data, size) == (ssize_t)size);
    return fd;
}

/* Packs bytes piece by piece. */
static int make_packed(const uint8_t *data, size_t size)
{
    spool_packer packer;
    size_t count;
    int fd = make_file("", 0);
    REQUIRE(journal_packer(&packer, size % 2));
    for (size_t used = 0; used < size; used += PIECE) {
        const size_t piece = size - used < PIECE ? size - used : PIECE;
        const void *bytes = packer.pack(packer.user, &count, data + used, piece);
        REQUIRE(bytes && write(fd, bytes, count) == (ssize_t)count);
        packer.settle(packer.user, true);
    }
    const void *end = packer.end(packer.user, &count);
    REQUIRE(end && write(fd, end, count) == (ssize_t)count);
    packer.free(packer.user);
    return fd;
}

static journal_outcome play_file(run *r, int fd, bool stepping)
{
    char path[32];
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    const journal_outcome outcome = play_aloud(r, path, stepping);
    (void)close(fd);
    return outcome;
}

/* Plays something that must be as a run has been. */
static void play_again(const run *first, journal_outcome outcome, int fd)
{
    run other;
    REQUIRE(play_file(&other, fd, false) == outcome);
    REQUIRE(strcmp(first->text, other.text) == 0);
    free(other.text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    run stepped;
    const bool is_packed = size > 0 && data[0] == MAGIC;
    const journal_outcome outcome = play_file(&stepped, make_file(data, size), true);
    play_again(&stepped, outcome, make_file(data, size));
    if (size > 0 && !is_packed)
        play_again(&stepped, outcome, make_packed(data, size));
    free(stepped.text);
    return 0;
}
