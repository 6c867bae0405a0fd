/* SPDX-License-Identifier: MIT
 *
 * test_pcapng.c - captures that are written: their bytes, and what our own reader makes of them.
 */
#include "cases.h"
#include "record/pcapng.h"

#include "base/text/number.h"
#include "base/version.h"
#include "trace/errframe.h"
#include "trace/read.h"

#include <unistd.h>

#define TIME_NS UINT64_C(0x0123456789ABCDEF)

static char engine[] = "engine";
static char load[] = "a-load";
static char vcan0[] = "vcan0";
static cfg_node nodes[] = {{.name = engine, .port = vcan0}, {.name = load}};
static const cfg config = {.bitrate_bps = 500000, .node_count = 2, .nodes = nodes};

/* Returns the written bytes as hexadecimal text, to be freed. */
static char *hexadecimal(const unsigned char *bytes, size_t size)
{
    char *text = calloc(2 * size + 1, 1);
    assert_non_null(text);
    for (size_t i = 0; i < size; i++)
        sprintf(text + 2 * i, "%02X", bytes[i]);
    return text;
}

static char *written(const cw_event *event)
{
    FREED char *bytes = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&bytes, &size);
    assert_non_null(out);
    if (event)
        pcapng_event(out, &config, event, TIME_NS);
    else
        pcapng_begin(out, &config);
    assert_int_equal(fclose(out), 0);
    char *text = hexadecimal((unsigned char *)bytes, size);
    return text;
}

/* ---- Bytes ----------------------------------------------------------------------------------- */

TEST(begins_with_a_section_and_an_interface_for_each_node)
{
    FREED char *text = written(NULL);
    char application[128] = "";
    for (const char *c = "canwire " CANWIRE_VERSION; *c; c++)
        sprintf(application + strlen(application), "%02X", (unsigned)*c);
    assert_memory_equal(text, "0A0D0D0A", 8);
    assert_memory_equal(text + 16, "4D3C2B1A01000000FFFFFFFFFFFFFFFF", 32);
    assert_non_null(strstr(text, application));
    const char *at = strstr(text, "0100000044000000");
    assert_non_null(at);
    assert_string_equal(at, "0100000044000000" "E300000000000000"
                            "02000500" "7663616E30000000"   /* vcan0 */
                            "03000600" "656E67696E650000"   /* engine */
                            "08000800" "20A1070000000000"   /* 500000 */
                            "09000100" "09000000" "00000000" "44000000"
                            "0100000044000000" "E300000000000000"
                            "02000600" "612D6C6F61640000"   /* a-load */
                            "03000600" "612D6C6F61640000"
                            "08000800" "20A1070000000000"
                            "09000100" "09000000" "00000000" "44000000");
}

#define TIME "67452301EFCDAB89"
#define OUTBOUND "0200040002000000" "00000000"
#define INBOUND "0200040001000000" "00000000"

typedef struct packet_case {
    const char *name;
    cw_event event;
    const char *bytes;
} packet_case;

static const packet_case packets[] = {
    {"a data frame",
     {.kind = CW_EVENT_TX, .nodes = 1, .frame = {.id = 0x123, .dlc = 3, .data = {1, 2, 3}}},
     "0600000038000000" "00000000" TIME "0B0000000B000000"
     "0000012303000000" "01020300" OUTBOUND "38000000"},
    {"an extended remote frame of the other node",
     {.kind = CW_EVENT_TX,
      .nodes = 2,
      .frame = {.id = 0x12345678, .dlc = 5, .flags = CW_FRAME_EXTENDED | CW_FRAME_REMOTE}},
     "0600000034000000" "01000000" TIME "0800000008000000"
     "D234567805000000" OUTBOUND "34000000"},
    {"a DLC over 8",
     {.kind = CW_EVENT_TX,
      .nodes = 1,
      .frame = {.id = 0x7FF, .dlc = 15, .data = {1, 2, 3, 4, 5, 6, 7, 8}}},
     "060000003C000000" "00000000" TIME "1000000010000000"
     "000007FF0800000F" "0102030405060708" OUTBOUND "3C000000"},
    {"a CAN FD frame",
     {.kind = CW_EVENT_TX,
      .nodes = 1,
      .frame = {.id = 0x123, .flags = CW_FRAME_FD, .dlc = 3, .data = {1, 2, 3}}},
     "0600000038000000" "00000000" TIME "0B0000000B000000"
     "0000012303040000" "01020300" OUTBOUND "38000000"},
    {"an extended one with 12 bytes, BRS and ESI",
     {.kind = CW_EVENT_TX,
      .nodes = 1,
      .frame = {.id = 0x12345678,
                .flags = CW_FRAME_EXTENDED | CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_ESI,
                .dlc = 9,
                .data = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}}},
     "0600000040000000" "00000000" TIME "1400000014000000"
     "923456780C070000" "0102030405060708090A0B0C" OUTBOUND "40000000"},
    {"a frame that two nodes have sent as one",
     {.kind = CW_EVENT_TX, .nodes = 3, .frame = {.id = 1}},
     "0600000034000000" "00000000" TIME "0800000008000000"
     "0000000100000000" OUTBOUND "34000000"
     "0600000034000000" "01000000" TIME "0800000008000000"
     "0000000100000000" OUTBOUND "34000000"},
    {"bus-off",
     {.kind = CW_EVENT_STATE, .nodes = 2, .state = CW_STATE_BUS_OFF, .tec = 256},
     "060000003C000000" "01000000" TIME "1000000010000000"
     "2000004008000000" "0000000000000000" INBOUND "3C000000"},
    {"a bus error, whatever berr-reporting says",
     {.kind = CW_EVENT_ERROR,
      .nodes = 1,
      .tec = 8,
      .rec = 1,
      .error = {.type = CW_ERROR_ACK,
                .role = CW_ROLE_TRANSMITTER,
                .place = {.field = CW_FIELD_ACK_SLOT}}},
     "060000003C000000" "00000000" TIME "1000000010000000"
     "200002A808000000" "0000801900000801" INBOUND "3C000000"},
    {"a received frame: it was written as its sender's", {.kind = CW_EVENT_RX, .nodes = 2}, ""},
    {"a fault", {.kind = CW_EVENT_FAULT}, ""},
    {"a drop that no driver tells", {.kind = CW_EVENT_DROP, .nodes = 1, .why = CW_DROP_FAULT}, ""},
};

TEST_ROWS(writes_the_packet, packets)
{
    const packet_case *expected = *state;
    FREED char *text = written(&expected->event);
    assert_string_equal(text, expected->bytes);
}

/* ---- There and back -------------------------------------------------------------------------- */

static const cw_frame frames[] = {
    {.id = 0, .dlc = 0},
    {.id = 0x7FF, .dlc = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}},
    {.id = 0x1FFFFFFF, .dlc = 1, .flags = CW_FRAME_EXTENDED, .data = {0xFF}},
    {.id = 0x123, .dlc = 4, .flags = CW_FRAME_REMOTE},
    {.id = 0x123, .dlc = 15, .flags = CW_FRAME_REMOTE},
    {.id = 0x124, .dlc = 9, .data = {8, 7, 6, 5, 4, 3, 2, 1}},
};

static uint64_t time_of(size_t i)
{
    return UINT64_C(1700000000123456789) + i;
}

/* Writes frames of both nodes in turn, with an error frame behind each. */
static void write_all(FILE *out)
{
    pcapng_begin(out, &config);
    for (size_t i = 0; i < COUNT(frames); i++) {
        const cw_event sent = {.kind = CW_EVENT_TX, .nodes = 1u << i % 2, .frame = frames[i]};
        const cw_event restart = {.kind = CW_EVENT_RESTART, .nodes = 1};
        pcapng_event(out, &config, &sent, time_of(i));
        pcapng_event(out, &config, &restart, time_of(i));
    }
}

static void check_all(trace_reader *reader)
{
    trace_record r;
    for (size_t i = 0; i < COUNT(frames); i++) {
        assert_int_equal(trace_next(reader, &r), TRACE_RECORD);
        assert_int_equal(r.kind, TRACE_FRAME);
        assert_true(r.timed);
        assert_int_equal(r.time_ns, time_of(i));
        assert_string_equal(r.channel, i % 2 ? "a-load" : "vcan0");
        assert_true(cw_frame_equal(&r.frame, &frames[i]));
        assert_int_equal(trace_next(reader, &r), TRACE_RECORD);
        assert_int_equal(r.kind, TRACE_ERROR_FRAME);
        assert_string_equal(r.channel, "vcan0");
    }
    assert_int_equal(trace_next(reader, &r), TRACE_END);
}

TEST(our_reader_reads_what_was_written)
{
    char file[] = "/tmp/canwire-pcapng-XXXXXX";
    char problem[TRACE_PROBLEM_MAX];
    int fd = mkstemp(file);
    FILE *out = fd >= 0 ? fdopen(fd, "w") : NULL;
    assert_non_null(out);
    write_all(out);
    assert_int_equal(fclose(out), 0);
    trace_reader *reader = trace_open(file, TRACE_DETECT, problem);
    unlink(file);
    assert_non_null(reader);
    check_all(reader);
    trace_close(reader);
}
