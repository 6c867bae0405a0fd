/* SPDX-License-Identifier: MIT
 *
 * fuzz_trace.c - recordings of any format: what is read is valid, the same each time, and a
 * complaint says where.
 */
#include "fuzz.h"

#include "run/replay.h"
#include "trace/read.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define BIT_TICKS 160u

static void check_record(const trace_record *r, uint64_t *place)
{
    REQUIRE(r->kind < TRACE_KIND_COUNT);
    REQUIRE((r->kind != TRACE_FRAME && r->kind != TRACE_FD_FRAME) ||
            (cw_frame_valid(&r->frame) &&
             (r->kind == TRACE_FD_FRAME) == ((r->frame.flags & CW_FRAME_FD) != 0)));
    REQUIRE(strlen(r->channel) < TRACE_CHANNEL_MAX);
    REQUIRE(r->place >= *place);
    *place = r->place;
}

/* Reads all entries; returns their number, or UINT64_MAX for a file that is no recording. */
static uint64_t read_all(trace_reader *reader, const char *file)
{
    uint64_t entries = 0;
    uint64_t damaged = 0;
    uint64_t place = 0;
    trace_record record;
    trace_result result;
    while ((result = trace_next(reader, &record)) == TRACE_RECORD) {
        check_record(&record, &place);
        damaged += record.kind == TRACE_DAMAGED;
        entries++;
    }
    REQUIRE(damaged < entries || damaged < TRACE_DAMAGED_MAX);
    REQUIRE(trace_position(reader) <= trace_size(reader));
    if (result == TRACE_END)
        return entries;
    const char *problem = trace_problem(reader);
    REQUIRE(trace_next(reader, &record) == TRACE_BAD);
    REQUIRE(strncmp(problem, file, strlen(file)) == 0 && problem[strlen(file)] == ':');
    REQUIRE(strpbrk(problem, "\n\r\t") == NULL);
    return UINT64_MAX;
}

static void read_as(const char *file, trace_format format)
{
    char problem[TRACE_PROBLEM_MAX];
    trace_reader *reader = trace_open(file, format, problem);
    if (!reader) {
        REQUIRE(format == TRACE_DETECT && strncmp(problem, file, strlen(file)) == 0);
        return;
    }
    uint64_t entries = read_all(reader, file);
    REQUIRE(entries == UINT64_MAX ||
            (trace_rewind(reader) && read_all(reader, file) == entries));
    trace_close(reader);
}

/* Plays a file. Ticks never step back, and the file ends as often as it is asked for. */
static void play(const char *file, const fuzz_input *options)
{
    fuzz_input in = *options;
    char name[64];
    char problem[TRACE_PROBLEM_MAX];
    char note[REPLAY_NOTE_MAX];
    cw_frame frame;
    uint64_t tick = 0;
    uint64_t before = 0;
    replay_step step;
    (void)snprintf(name, sizeof name, "%s", file);
    cfg_traffic traffic = {.kind = CFG_TRAFFIC_REPLAY,
                           .file = name,
                           .format = (trace_format)fuzz_below(&in, 5),
                           .fast = fuzz_bool(&in),
                           .fd = fuzz_bool(&in),
                           .count = 1 + fuzz_below(&in, 3),
                           .filters = {{.value = fuzz_u32(&in), .mask = fuzz_u8(&in)}},
                           .filter_count = fuzz_bool(&in),
                           .gap = {.ns = fuzz_u32(&in)}};
    replay *r = replay_open(&traffic, cw_rate_of(BIT_TICKS), fuzz_u8(&in), problem);
    if (!r)
        return;
    while ((step = replay_next(r, &frame, &tick)) <= REPLAY_PAUSE) {
        REQUIRE(tick >= before);
        REQUIRE(step == REPLAY_PAUSE || cw_frame_valid(&frame));
        REQUIRE(replay_permille(r) <= 1000);
        before = tick;
    }
    REQUIRE(step == REPLAY_OVER || replay_problem(r)[0] != '\0');
    REQUIRE(!replay_note(r, false, note) || strncmp(note, file, strlen(file)) == 0);
    replay_close(r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char file[64];
    int fd = memfd_create("trace", MFD_CLOEXEC);
    REQUIRE(fd >= 0);
    REQUIRE(size == 0 || write(fd, data, size) == (ssize_t)size);
    (void)snprintf(file, sizeof file, "/proc/self/fd/%d", fd);
    for (unsigned format = TRACE_DETECT; format <= TRACE_PCAPNG; format++)
        read_as(file, (trace_format)format);
    size_t options = size < 16 ? size : 16; /* the last bytes also say how it is played */
    fuzz_input in = {.data = data + size - options, .left = options};
    if (size > 0)
        play(file, &in);
    (void)close(fd);
    return 0;
}
