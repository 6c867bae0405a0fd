/* SPDX-License-Identifier: MIT
 *
 * fuzz_frame.c - the readers of frametext.h and number.h. Accepted values are in range and print as
 * they were read, and a frame passes the wire unchanged.
 */
#include "fuzz.h"

#include "base/text/number.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define BIT_TICKS 160u
#define JOIN_BITS 11u

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Checks that a receiver gets the encoded frame. */
static void send_over_wire(const cw_frame *frame)
{
    cw_bits bits;
    cw_mac mac;
    cw_fd_part fd;
    cw_mac_report report = {.what = 0};
    REQUIRE(cw_bits_encode(&bits, frame) == CW_OK);
    REQUIRE(bits.length <= CW_BITS_MAX);
    cw_mac_init(&mac, 0, 96);
    if (frame->flags & CW_FRAME_FD) {
        unsigned format = frame->flags & CW_FRAME_NON_ISO ? CW_PROTOCOL_NON_ISO : 0;
        REQUIRE(cw_mac_set_protocol(&mac, CW_FD | format, &fd) == CW_OK);
    }
    for (unsigned i = 0; i < JOIN_BITS; i++) {
        (void)cw_mac_drive(&mac);
        cw_mac_sample(&mac, CW_RECESSIVE, &report);
    }
    unsigned received = 0;
    for (unsigned i = 0; i < bits.length; i++) {
        bool own = cw_mac_drive(&mac);
        cw_mac_sample(&mac, own && cw_bits_level(&bits, i), &report);
        REQUIRE(!(report.what & CW_REPORT_ERROR));
        received += (report.what & CW_REPORT_RX) != 0;
    }
    REQUIRE(received == 1 && cw_frame_equal(cw_mac_received(&mac), frame));
}

/* Reads the printed text again, which must give the same frame and the same text. The text does not
 * say which format of CAN FD it is. */
static void print_and_read(const cw_frame *printable)
{
    cw_frame iso = *printable;
    const cw_frame *frame = &iso;
    iso.flags &= (uint8_t)~CW_FRAME_NON_ISO;
    char printed[FRAME_TEXT_MAX];
    char again[FRAME_TEXT_MAX];
    cw_frame read;
    text_print_frame(printed, frame);
    REQUIRE(text_parse_frame(&read, printed) == NULL);
    REQUIRE(cw_frame_equal(&read, frame));
    text_print_frame(again, &read);
    REQUIRE(strcmp(printed, again) == 0);
}

static void frames(const char *text, const uint8_t *data, size_t size)
{
    cw_frame frame;
    char printed[FRAME_TEXT_MAX];
    if (!text_parse_frame(&frame, text)) {
        REQUIRE(cw_frame_valid(&frame));
        print_and_read(&frame);
        send_over_wire(&frame);
    }
    memset(&frame, 0, sizeof frame); /* any bytes at all can be printed */
    memcpy(&frame, data, size < sizeof frame ? size : sizeof frame);
    text_print_frame(printed, &frame);
    REQUIRE(strlen(printed) < sizeof printed);
    if (cw_frame_valid(&frame)) {
        print_and_read(&frame);
        send_over_wire(&frame);
    }
}

/* ---- Conditions ------------------------------------------------------------------------------ */

static void filters(const char *text)
{
    cw_filter out[CW_RULE_FILTERS_MAX + 1];
    unsigned count = 0;
    memset(out, 0xA5, sizeof out);
    const cw_filter untouched = out[CW_RULE_FILTERS_MAX];
    const char *problem = text_parse_filters(out, &count, CW_RULE_FILTERS_MAX, text);
    REQUIRE(problem ? count == 0 : count >= 1 && count <= CW_RULE_FILTERS_MAX);
    REQUIRE(memcmp(&untouched, &out[CW_RULE_FILTERS_MAX], sizeof untouched) == 0);
    uint32_t mask = 0;
    REQUIRE((text_parse_error_mask(&mask, text) == NULL) == (mask != 0));
}

static void identifiers(const char *text)
{
    uint32_t id;
    uint8_t flags;
    if (text_parse_id(&id, &flags, text))
        return;
    REQUIRE((flags & ~CW_FRAME_EXTENDED) == 0);
    REQUIRE(id <= (flags ? 0x1FFFFFFFu : 0x7FFu));
    REQUIRE(strtoul(text, NULL, 16) == id);
}

static void patterns(const char *text, bool fd)
{
    text_bytes bytes;
    text_levels levels;
    if (!text_parse_bytes(&bytes, text, fd)) {
        REQUIRE(bytes.length >= 1 && bytes.length <= (fd ? 64 : 8));
        for (unsigned i = 0; i < 64; i++)
            REQUIRE((bytes.value[i] & ~bytes.mask[i]) == 0);
    }
    if (!text_parse_levels(&levels, text)) {
        REQUIRE(levels.bits == strlen(text) && levels.bits <= CW_PATTERN_MAX);
        REQUIRE((levels.level & ~levels.mask) == 0 && levels.mask != 0);
    }
}

static void positions(const char *text, bool fd)
{
    cw_field field, again;
    uint16_t index, index_again;
    char name[64];
    if (text_parse_position(&field, &index, text, fd))
        return;
    REQUIRE(field > CW_FIELD_NONE && field < CW_FIELD_COUNT);
    REQUIRE(text_parse_position(&again, &index_again, text, true) == NULL);
    REQUIRE(again == field && index_again == index);
    const char *behind = strchr(text, '[');
    if (!behind)
        REQUIRE(index == 0 && strcmp(text, cw_field_name(field)) == 0);
    else if (field == CW_FIELD_DATA)
        (void)snprintf(name, sizeof name, "data[%u.%u]", index / 8u, index % 8u);
    else
        (void)snprintf(name, sizeof name, "%s[%u]", cw_field_name(field), index);
    REQUIRE(!behind || strcmp(text, name) == 0);
}

/* ---- Numbers --------------------------------------------------------------------------------- */

static void numbers(const char *text)
{
    uint64_t number;
    uint16_t permille;
    char printed[32];
    if (!text_parse_uint(&number, text)) {
        (void)snprintf(printed, sizeof printed, "%" PRIu64, number);
        REQUIRE(strcmp(printed, text) == 0);
    }
    if (!text_parse_percent(&permille, text))
        REQUIRE(permille >= 1 && permille <= 1000);
    if (!text_parse_probability(&number, text)) {
        double wanted = strtod(text, NULL);
        double got = (double)number / 18446744073709551616.0;
        REQUIRE(got <= wanted + 1e-9 && got >= wanted - 1e-9);
    }
}

static void times(const char *text)
{
    cfg_time time;
    char printed[TIME_TEXT_MAX];
    if (text_parse_time(&time, text))
        return;
    const cw_rate rate = cw_rate_of(BIT_TICKS);
    uint64_t once = text_time_ticks(time, rate);
    uint64_t twice = text_time_ticks_sum(time, 1, time, rate);
    REQUIRE(once == text_time_ticks_sum(time, 0, time, rate));
    REQUIRE(twice >= once && (twice == UINT64_MAX || twice <= 2 * once));
    REQUIRE(twice == UINT64_MAX || twice + 1 >= 2 * once); /* rounded up once, not twice */
    text_print_seconds(printed, once);
    REQUIRE(strlen(printed) < sizeof printed);
    text_print_log_time(printed, once);
    REQUIRE(strlen(printed) < sizeof printed);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const uint8_t none[1];
    char *text = fuzz_text(data, size);
    frames(text, data ? data : none, size);
    filters(text);
    identifiers(text);
    patterns(text, false);
    patterns(text, true);
    positions(text, false);
    positions(text, true);
    numbers(text);
    times(text);
    free(text);
    return 0;
}
