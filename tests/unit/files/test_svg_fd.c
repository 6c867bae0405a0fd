/* SPDX-License-Identifier: MIT
 *
 * test_svg_fd.c - pictures of CAN FD frames: bits of all lengths to scale.
 */
#include "cases.h"
#include "cli/svg/svg.h"
#include "fd_bus.h"

#define JOIN 11u /* bits until nodes may send (M10) */

static const cw_frame frame = {
    .id = 0x123, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 2, .data = {0xAA, 0x55}};

static void take_bits(svg *s, cw_bus *bus, unsigned bits)
{
    cw_bit_view view;
    cw_event event;

    for (unsigned n = 0; n < bits; n++) {
        const uint64_t now = cw_bus_now(bus);
        uint64_t tick = now + FD_DATA_TICKS; /* no bit is shorter */
        while (cw_bus_now(bus) == now)
            assert_int_equal(cw_bus_advance(bus, tick++), CW_OK);
        while (cw_bus_poll(bus, &event))
            if (s)
                assert_true(svg_event(s, &event));
        assert_int_equal(cw_bus_get_bit(bus, &view), CW_OK);
        if (s)
            assert_true(svg_bit(s, &view));
    }
}

/* Draws a frame, from SOF to the end of intermission. */
static char *picture(unsigned protocol, bool has_rate, cw_frame sent)
{
    const cw_node_timing timing[2] = {fd_bus_timing(has_rate), fd_bus_timing(has_rate)};
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    fd_bus r;

    assert_non_null(out);
    fd_bus_begin(&r, protocol, has_rate ? timing : NULL, NULL);
    assert_int_equal(cw_node_send(r.bus, 0, &sent, 0), CW_OK);
    cw_bus_set_watching(r.bus, true);
    take_bits(NULL, r.bus, JOIN);
    svg *s = svg_new(&r.config, r.bus);
    assert_non_null(s);
    take_bits(s, r.bus, cw_frame_wire_bits(&sent) + 3);
    assert_true(svg_write(out, s, CW_NEVER));
    assert_int_equal(fclose(out), 0);
    svg_free(s);
    fd_bus_end(&r);
    return text;
}

/* Returns the width of the first rectangle of a class. */
static int width_of(const char *text, const char *name, int *x)
{
    char begin[64];
    int y, width = 0;

    snprintf(begin, sizeof begin, "<rect class=\"%s\" ", name);
    const char *at = strstr(text, begin);
    assert_non_null(at);
    at += strlen(begin);
    assert_int_equal(sscanf(at, "x=\"%d\" y=\"%d\" width=\"%d\"", x, &y, &width), 3);
    return width;
}

TEST(bits_are_to_scale)
{
    static const struct {
        const char *name;
        unsigned ticks;
    } fields[] = {
        {"field sof", FD_BIT_TICKS},        {"field ide", FD_BIT_TICKS},
        {"field fdf", FD_BIT_TICKS},        {"field res", FD_BIT_TICKS},
        {"field brs", FD_BRS_TICKS},        {"field esi", FD_DATA_TICKS},
        {"field dlc", 4 * FD_DATA_TICKS},   {"field data[0]", 8 * FD_DATA_TICKS},
        {"field data[1]", 8 * FD_DATA_TICKS}, {"field crc-delimiter", FD_DELIMITER_TICKS},
        {"field ack-slot", 2 * FD_BIT_TICKS}, {"field ack-delimiter", FD_BIT_TICKS},
    };
    FREED char *text = picture(CW_FD, true, frame);
    int x;
    const int data_bit = width_of(text, "field esi", &x);

    assert_in_range(data_bit, 9, 24);
    for (size_t i = 0; i < sizeof fields / sizeof fields[0]; i++) {
        const int wanted = (int)fields[i].ticks * data_bit / (int)FD_DATA_TICKS;
        const int width = width_of(text, fields[i].name, &x);
        assert_in_range(width, wanted - 1, wanted + 1);
    }
}

TEST(the_data_phase_has_a_bar)
{
    FREED char *text = picture(CW_FD, true, frame);
    int esi, bar;

    (void)width_of(text, "field esi", &esi);
    const char *at = strstr(text, "class=\"data-rate\"");
    assert_non_null(at);
    while (*at != '<')
        at--;
    assert_int_equal(sscanf(at, "<rect x=\"%d\"", &bar), 1);
    assert_int_equal(bar, esi);
    assert_non_null(strstr(text, ">500000 and 2000000 bit/s, 22 to "));
    assert_non_null(strstr(text, ">begun at the data rate, 2000000 bit/s; all bits are to scale<"));
}

/* The numbers of bits are those of the bus, although not all are as long as others. */
TEST(bits_are_numbered)
{
    FREED char *text = picture(CW_FD, true, frame);
    const unsigned last = JOIN + cw_frame_wire_bits(&frame) + 3;
    char number[32];

    for (unsigned n = JOIN; n <= last; n++) {
        snprintf(number, sizeof number, "\">%u</text>", n);
        if (n % 10 == 0 && n + 3 < last)
            assert_non_null(strstr(text, number));
    }
}

TEST(events_stand_at_the_ends_of_their_bits)
{
    FREED char *text = picture(CW_FD, true, frame);
    int x;

    const int width = width_of(text, "field intermission", &x);
    char sent[64];
    assert_non_null(strstr(text, ">sent 123##1AA55<"));
    snprintf(sent, sizeof sent, "<path d=\"M%d ", x); /* the end of EOF is where it begins */
    assert_non_null(strstr(text, sent));
    assert_true(width > 0);
}

TEST(a_classical_picture_tells_nothing_of_rates)
{
    FREED char *text = picture(CW_CLASSICAL, false, (cw_frame){.id = 0x123, .dlc = 2});

    assert_null(strstr(text, "data-rate"));
    assert_null(strstr(text, "data rate"));
    assert_non_null(strstr(text, ">500000 bit/s, 22 to "));
}
