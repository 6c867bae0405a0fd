/* SPDX-License-Identifier: MIT
 *
 * test_vcd_fd.c - dumps of CAN FD frames: each bit at its real time, also while nodes disagree.
 */
#include "cases.h"
#include "fd_bus.h"
#include "record/vcd.h"

#define JOIN 11u /* bits until nodes may send (M10) */
#define UNIT_NS 10u
#define TICKS_NS(ticks) ((ticks) * 25u / 2u)

/* Takes the bits of a bus into a dump, each behind its events. */
static void take_bits(vcd *v, cw_bus *bus, unsigned bits)
{
    cw_bit_view view;
    cw_event event;

    for (unsigned n = 0; n < bits; n++) {
        const uint64_t now = cw_bus_now(bus);
        uint64_t tick = now + FD_DATA_TICKS; /* no bit is shorter */
        while (cw_bus_now(bus) == now)
            assert_int_equal(cw_bus_advance(bus, tick++), CW_OK);
        while (cw_bus_poll(bus, &event))
            vcd_event(v, &event);
        assert_int_equal(cw_bus_get_bit(bus, &view), CW_OK);
        vcd_bit(v, &view);
    }
}

static void begin(fd_bus *r, cw_span delay, cw_rule *rule)
{
    cw_node_timing timing[2] = {fd_bus_timing(true), fd_bus_timing(true)};
    timing[1].rx_delay[0] = timing[1].rx_delay[1] = delay;
    fd_bus_begin(r, CW_FD, timing, rule);
}

static char *dump(fd_bus *r, unsigned bits)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);

    assert_non_null(out);
    cw_bus_set_watching(r->bus, true);
    vcd *v = vcd_open(out, &r->config, r->bus);
    assert_non_null(v);
    take_bits(v, r->bus, bits);
    vcd_close(v);
    assert_int_equal(fclose(out), 0);
    return text;
}

/* Finds the last change of a variable up to a time, in units. Returns its line, without the end of
 * the line and the variable, or "". */
static const char *value_at(char line[64], const char *text, const char *id, uint64_t time)
{
    const size_t id_length = strlen(id);
    unsigned long long now = 0;

    line[0] = '\0';
    for (const char *at = strstr(text, "$dumpvars"); at && *at; at = strchr(at, '\n') + 1) {
        const size_t length = strcspn(at, "\n");
        if (*at == '#' && sscanf(at, "#%llu", &now) == 1 && now > time)
            break;
        if (*at == '#' || *at == '$' || length < id_length || length - id_length >= 64 ||
            strncmp(at + length - id_length, id, id_length) != 0)
            continue;
        memcpy(line, at, length - id_length);
        line[length - id_length] = '\0';
    }
    return line;
}

static const cw_frame frames[] = {
    {.id = 0x123, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 4, .data = {0xDE, 0xAD, 0xBE, 0xEF}},
    {.id = 0x555, .flags = CW_FRAME_FD | CW_FRAME_BRS},
    {.id = 0x1FFFFFFF,
     .flags = CW_FRAME_EXTENDED | CW_FRAME_FD | CW_FRAME_BRS,
     .dlc = 13,
     .data = {[31] = 0xFF}},
    {.id = 0x7FF, .flags = CW_FRAME_FD, .dlc = 15},
    {.id = 0x123, .dlc = 8},
};

/* Checks level, field and stuff flag shortly behind the begin of a bit and before its end. */
static void check_bit(const char *text, const cw_bits *bits, unsigned n, uint64_t ticks)
{
    const uint64_t begin = TICKS_NS(ticks) / UNIT_NS;
    const uint64_t last = TICKS_NS(ticks + fd_bus_ticks(bits, n)) / UNIT_NS - 1;
    const cw_place place = cw_bits_place(bits, n);
    char line[64], field[32];

    if (place.field == CW_FIELD_DATA)
        snprintf(field, sizeof field, "sdata[%u] ", place.index / 8u);
    else
        snprintf(field, sizeof field, "s%s ", cw_field_name(place.field));
    for (unsigned i = 0; i < 2; i++) {
        const uint64_t time = i ? last : begin;
        assert_string_equal(value_at(line, text, "d0", time), cw_bits_level(bits, n) ? "1" : "0");
        assert_string_equal(value_at(line, text, "f0", time), field);
        if (n > 0) /* SOF comes unexpected */
            assert_string_equal(value_at(line, text, "f1", time), field);
        assert_string_equal(value_at(line, text, "t0", time), place.stuff ? "1" : "0");
    }
}

TEST(each_bit_has_its_real_time)
{
    for (size_t i = 0; i < sizeof frames / sizeof frames[0]; i++) {
        fd_bus r;
        cw_bits bits;
        char line[64];

        begin(&r, 0, NULL);
        assert_int_equal(cw_bits_encode(&bits, &frames[i]), CW_OK);
        assert_int_equal(cw_node_send(r.bus, 0, &frames[i], 0), CW_OK);
        char *text = dump(&r, JOIN + bits.length + 3u);
        assert_non_null(strstr(text, "$timescale 10 ns $end"));
        assert_null(strstr(text, "a.tq"));
        uint64_t ticks = (uint64_t)JOIN * FD_BIT_TICKS;
        for (unsigned n = 0; n < bits.length; n++) {
            check_bit(text, &bits, n, ticks);
            ticks += fd_bus_ticks(&bits, n);
        }
        assert_string_equal(value_at(line, text, "f0", TICKS_NS(ticks) / UNIT_NS),
                            "sintermission ");
        char end[32];
        snprintf(end, sizeof end, "\n#%u\n",
                 (unsigned)(TICKS_NS(ticks + 3u * FD_BIT_TICKS) / UNIT_NS));
        assert_string_equal(text + strlen(text) - strlen(end), end);
        free(text);
        fd_bus_end(&r);
    }
}

/* Node b samples BRS as dominant, so it stays at the nominal rate and falls out of step (D11). It
 * goes on in bits of 2 us, while a is at 500 ns. */
TEST(nodes_that_fall_out_of_step_have_their_true_times)
{
    cw_rule rule = {.name = "blind",
                    .time_end = CW_NEVER,
                    .count = 1,
                    .probability = UINT64_MAX,
                    .action = CW_ACTION_FLIP,
                    .field = CW_FIELD_BRS,
                    .bits = 1,
                    .at = 2};
    fd_bus r;
    char line[64];
    cw_bits bits;

    begin(&r, 8 * CW_TICK, &rule);
    assert_int_equal(cw_bits_encode(&bits, &frames[0]), CW_OK);
    assert_int_equal(cw_node_send(r.bus, 0, &frames[0], 0), CW_OK);
    char *text = dump(&r, 60);
    uint64_t ticks = (uint64_t)JOIN * FD_BIT_TICKS;
    unsigned n = 0;
    for (; !cw_bits_is_fast(&bits, n); n++)
        ticks += fd_bus_ticks(&bits, n);
    for (unsigned seen = 0; seen < 6; seen++, n++) { /* until a node signals an error */
        const uint64_t middle = TICKS_NS(ticks + FD_DATA_TICKS / 2) * 10; /* 100 ps */
        value_at(line, text, "d0", middle);
        assert_string_equal(line, cw_bits_level(&bits, n) ? "1" : "0");
        ticks += FD_DATA_TICKS;
    }
    assert_non_null(strstr(text, "serror-flag f1"));
    assert_non_null(strstr(text, "$var wire 1 u0 a.tq $end"));
    free(text);
    fd_bus_end(&r);
}

TEST(a_bus_without_a_data_rate_has_the_former_dump)
{
    char *texts[2];
    for (unsigned i = 0; i < 2; i++) {
        fd_bus r;
        const cw_node_timing timing[2] = {fd_bus_timing(false), fd_bus_timing(false)};
        fd_bus_begin(&r, i ? CW_FD : CW_CLASSICAL, i ? timing : NULL, NULL);
        assert_int_equal(cw_node_send(r.bus, 0, &frames[4], 0), CW_OK);
        texts[i] = dump(&r, 150);
        fd_bus_end(&r);
    }
    assert_string_equal(texts[0], texts[1]);
    assert_non_null(strstr(texts[0], "$timescale 100 ns $end"));
    free(texts[0]);
    free(texts[1]);
}
