/* SPDX-License-Identifier: MIT
 *
 * test_torn.c - recordings of recorders that were killed, and of machines that crashed. Bytes are
 * missing or zero: entries that nothing has touched are read, and the others are told.
 */
#include "cases.h"
#include "trace/read.h"

#include <inttypes.h>
#include <sys/mman.h>
#include <unistd.h>

#define FRAMES 5u
#define BYTES_MAX 2048u
#define PCAP_HEAD 16u
#define CRASH 5000u /* bytes 0, more than a line may have */

/* A recording: frame i has the identifier 100 + i and i bytes of 0x11 * i. */
typedef struct recording {
    trace_format format;
    bool big_endian;
    size_t begin[FRAMES + 1]; /* of each entry, and the end */
    size_t size;
    unsigned char bytes[BYTES_MAX + CRASH + BYTES_MAX];
} recording;

/* The entries that were read of it. */
typedef struct reading {
    bool refused;
    bool seen[FRAMES]; /* frame i, as it was recorded */
    unsigned frames;   /* all, also those that nobody has recorded */
    unsigned cut;      /* frames whose line has no end */
    unsigned others; /* in ASC an event with another word, in pcap a frame with other flags */
    unsigned damaged;
    uint64_t damaged_bytes;
} reading;

/* ---- Recordings ------------------------------------------------------------------------------ */

static void put_text(recording *r, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void put_text(recording *r, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    r->size += (size_t)vsnprintf((char *)r->bytes + r->size, BYTES_MAX - r->size, format, args);
    va_end(args);
}

static void put(recording *r, uint32_t value, unsigned bytes)
{
    for (unsigned i = 0; i < bytes; i++)
        r->bytes[r->size++] =
            (unsigned char)(value >> 8 * (r->big_endian ? bytes - 1 - i : i));
}

/* Puts the frame as SocketCAN has it, padded to a multiple of 4. */
static void put_frame(recording *r, unsigned i, bool padded)
{
    const unsigned char head[8] = {0, 0, 1, (unsigned char)i, (unsigned char)i};
    memcpy(r->bytes + r->size, head, sizeof head);
    memset(r->bytes + r->size + sizeof head, (int)(0x11 * i), i);
    r->size += sizeof head + (padded ? (i + 3u) & ~3u : i);
}

static void put_candump(recording *r)
{
    r->format = TRACE_CANDUMP;
    for (unsigned i = 0; i < FRAMES; i++) {
        r->begin[i] = r->size;
        put_text(r, "(%u.000000) can0 %03X#", 1000 + i, 0x100 + i);
        for (unsigned k = 0; k < i; k++)
            put_text(r, "%02X", 0x11 * i);
        put_text(r, "\n");
    }
}

static void put_asc(recording *r)
{
    r->format = TRACE_ASC;
    put_text(r, "date Sat Sep 30 10:06:13.191 am 2017\nbase hex  timestamps absolute\n");
    for (unsigned i = 0; i < FRAMES; i++) {
        r->begin[i] = r->size;
        put_text(r, "%u.000000 1  %X  Rx   d %u", 1 + i, 0x100 + i, i);
        for (unsigned k = 0; k < i; k++)
            put_text(r, " %02X", 0x11 * i);
        put_text(r, "\n");
    }
}

static void put_pcap(recording *r)
{
    static const uint32_t head[] = {0xA1B2C3D4, 0x00040002, 0, 0, 65535, 227};
    r->format = TRACE_PCAPNG;
    for (size_t i = 0; i < sizeof head / sizeof head[0]; i++)
        put(r, head[i], 4);
    for (unsigned i = 0; i < FRAMES; i++) {
        r->begin[i] = r->size;
        put(r, 1700000000 + i, 4);
        put(r, 250000, 4);
        put(r, 8 + i, 4);
        put(r, 8 + i, 4);
        put_frame(r, i, false);
    }
}

static void put_pcapng(recording *r)
{
    static const uint32_t head[] = {0x0A0D0D0A, 28,  0x1A2B3C4D, 1,     UINT32_MAX, UINT32_MAX,
                                    28,         1,   20};
    r->format = TRACE_PCAPNG;
    for (size_t i = 0; i < sizeof head / sizeof head[0]; i++)
        put(r, head[i], 4);
    put(r, 227, 2);
    put(r, 0, 2);
    put(r, 65535, 4);
    put(r, 20, 4);
    for (unsigned i = 0; i < FRAMES; i++) {
        const uint32_t length = 28 + 8 + ((i + 3u) & ~3u) + 4;
        r->begin[i] = r->size;
        put(r, 6, 4);
        put(r, length, 4);
        put(r, 0, 4);
        put(r, 0, 4);
        put(r, 1000000 * i, 4);
        put(r, 8 + i, 4);
        put(r, 8 + i, 4);
        put_frame(r, i, true);
        put(r, length, 4);
    }
}

typedef struct made {
    void (*put)(recording *r);
    bool big_endian;
} made;

static const made all[] = {{put_candump, false}, {put_asc, false},   {put_pcap, false},
                           {put_pcap, true},     {put_pcapng, false}, {put_pcapng, true}};

#define ALL (sizeof all / sizeof all[0])

static void make(recording *r, size_t which)
{
    *r = (recording){.big_endian = all[which].big_endian};
    all[which].put(r);
    r->begin[FRAMES] = r->size;
}

static bool is_pcap(const made *m)
{
    return m->put == put_pcap;
}

static bool is_text(const recording *r)
{
    return r->format != TRACE_PCAPNG;
}

/* ---- Reading --------------------------------------------------------------------------------- */

static void note(reading *got, const trace_record *record)
{
    const unsigned i = record->frame.id - 0x100;
    if (record->kind == TRACE_DAMAGED) {
        got->damaged++;
        got->damaged_bytes += record->bytes;
        return;
    }
    if (record->kind != TRACE_FRAME) {
        got->others++;
        return;
    }
    got->frames++;
    got->cut += record->cut;
    if (i >= FRAMES || record->frame.dlc != i)
        return;
    for (unsigned k = 0; k < i; k++)
        if (record->frame.data[k] != 0x11 * i)
            return;
    got->seen[i] = true;
}

static reading read_bytes(const recording *r, size_t size)
{
    char name[64];
    char problem[TRACE_PROBLEM_MAX];
    reading got = {.refused = true};
    trace_record record;
    trace_result result;
    const int fd = memfd_create("torn", MFD_CLOEXEC);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, r->bytes, size), size);
    (void)snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
    trace_reader *reader = trace_open(name, r->format, problem);
    assert_non_null(reader);
    while ((result = trace_next(reader, &record)) == TRACE_RECORD)
        note(&got, &record);
    got.refused = result == TRACE_BAD;
    assert_int_equal(got.damaged == 0, trace_damage(reader)[0] == '\0');
    trace_close(reader);
    (void)close(fd);
    return got;
}

/* Asserts that frames before `first` and from `next` on are there,. */
static void assert_got(const reading *got, unsigned first, unsigned next)
{
    assert_false(got->refused);
    for (unsigned i = 0; i < FRAMES; i++)
        if (i < first || i >= next)
            assert_true(got->seen[i]);
}

/* Returns the number of entries that end up to this byte. */
static unsigned ended(const recording *r, size_t byte)
{
    unsigned count = 0;
    while (count < FRAMES && r->begin[count + 1] <= byte)
        count++;
    return count;
}

/* Returns the next byte that is not 0. */
static size_t behind_zeros(const recording *r, size_t byte)
{
    while (byte < r->size && r->bytes[byte] == 0)
        byte++;
    return byte;
}

/* ---- Tests ----------------------------------------------------------------------------------- */

TEST(a_recording_is_cut_anywhere)
{
    for (size_t which = 0; which < ALL; which++) {
        recording r;
        make(&r, which);
        for (size_t size = r.begin[1]; size <= r.size; size++) {
            const reading got = read_bytes(&r, size);
            const unsigned whole = ended(&r, size);
            assert_got(&got, whole, FRAMES);
            const bool between = r.begin[whole] == size;
            assert_int_equal(got.frames + got.damaged, whole + !between);
            assert_int_equal(got.others, 0);
            assert_int_equal(got.frames - got.cut, whole); /* text may look whole */
            assert_int_equal(got.damaged_bytes, got.damaged ? size - r.begin[whole] : 0);
        }
    }
}

TEST(bytes_are_zero_behind_a_crash)
{
    for (size_t which = 0; which < ALL; which++) {
        recording r, zeros;
        make(&r, which);
        for (size_t size = r.begin[1]; size <= r.size; size++) {
            const unsigned whole = ended(&r, behind_zeros(&r, size));
            zeros = r;
            memset(zeros.bytes + size, 0, CRASH);
            const reading got = read_bytes(&zeros, size + CRASH);
            assert_got(&got, whole, FRAMES);
            if (!is_pcap(&all[which])) /* there, content may be 0 */
                assert_int_equal(got.frames, whole);
            assert_true(got.damaged == 1);
            assert_in_range(got.damaged_bytes, 1, CRASH + BYTES_MAX);
        }
    }
}

/* A recorder goes on behind a crash. */
TEST(what_follows_bytes_0_is_read)
{
    for (size_t which = 0; which < ALL; which++) {
        recording r, torn;
        make(&r, which);
        for (size_t from = r.begin[1]; from < r.begin[3]; from++) {
            const unsigned whole = ended(&r, from);
            torn = r;
            memset(torn.bytes + from, 0, r.begin[3] - from + CRASH);
            memcpy(torn.bytes + r.begin[3] + CRASH, r.bytes + r.begin[3], r.size - r.begin[3]);
            const reading got = read_bytes(&torn, r.size + CRASH);
            assert_got(&got, whole, 3);
            assert_true(got.damaged > 0);
        }
    }
}

/* All frames are there that the missing bytes leave alone. Packets of pcap have no mark at their
 * end: one on each side of the gap may be taken for a part of it. */
TEST(bytes_are_missing_amid_a_recording)
{
    for (size_t which = 0; which < ALL; which++) {
        recording r, torn;
        make(&r, which);
        for (size_t from = r.begin[1] + 1; from < r.begin[3]; from++)
            for (size_t to = from + 1; to < r.begin[3]; to++) {
                const bool beside = is_pcap(&all[which]);
                const unsigned next = ended(&r, is_text(&r) ? to : to - 1) + 1 + beside;
                torn = r;
                memmove(torn.bytes + from, r.bytes + to, r.size - to);
                const reading got = read_bytes(&torn, r.size - (to - from));
                assert_got(&got, ended(&r, from) - beside, next);
                /* the rest of two may look like one */
                assert_true(is_text(&r) || got.damaged > 0 || to - from > PCAP_HEAD);
                assert_true(is_text(&r) || is_pcap(&all[which]) || got.others == 0);
            }
    }
}

/* Any other bytes than recordings. */
TEST(other_files_are_refused)
{
    for (size_t which = 0; which < ALL; which++) {
        recording r;
        make(&r, which);
        const size_t head = r.begin[0];
        memset(r.bytes + head, 0, CRASH);
        assert_true(read_bytes(&r, head + CRASH).refused);
        for (size_t i = 0; i < CRASH; i++)
            r.bytes[head + i] = (unsigned char)(i % 61 == 60 ? '\n' : 'a' + i % 7);
        assert_true(read_bytes(&r, head + CRASH).refused);
    }
}
