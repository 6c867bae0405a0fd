/* SPDX-License-Identifier: MIT
 *
 * test_time.c - bits and ticks: where the wire is, and when bits of a frame begin.
 */
#include "rig.h"

#include "step/step.h"

#define FAR 1000u /* bits */

static const uint32_t rates[] = {1, 2, 3, 80, 160, 6400, UINT32_MAX};

#define RATES (sizeof rates / sizeof rates[0])

static cw_wire_time at_bit(uint32_t bit_ticks, uint64_t bits)
{
    cw_wire_time t = cw_wire_begin(cw_rate_of(bit_ticks));
    cw_wire_pass(&t, bits);
    return t;
}

/* ---- Bits and ticks -------------------------------------------------------------------------- */

TEST(bits_are_counted_in_ticks)
{
    for (unsigned i = 0; i < RATES; i++) {
        const cw_rate rate = cw_rate_of(rates[i]);
        uint64_t ticks = 0;
        for (uint64_t bits = 0; bits < FAR; bits++, ticks += rates[i]) {
            assert_int_equal(cw_rate_ticks(rate, bits), ticks);
            assert_int_equal(cw_rate_ticks_or_never(rate, bits), ticks);
            assert_int_equal(cw_rate_bits(rate, ticks), bits);
            assert_int_equal(cw_rate_bits(rate, ticks + rates[i] - 1), bits);
            assert_int_equal(cw_rate_bits_begun(rate, ticks), bits);
            assert_int_equal(cw_rate_bits_begun(rate, ticks + 1), bits + 1);
            assert_int_equal(cw_rate_bit_begin(rate, ticks), ticks);
            assert_int_equal(cw_rate_bit_begin(rate, ticks + rates[i] - 1), ticks);
            assert_int_equal(cw_rate_next_bit(rate, ticks), ticks);
            assert_int_equal(cw_rate_next_bit(rate, ticks + 1), ticks + rates[i]);
        }
        if (rates[i] > 2)
            assert_int_equal(cw_rate_next_bit(rate, CW_NEVER - 1), CW_NEVER);
        assert_int_equal(cw_rate_ticks_or_never(rate, CW_BITS_FOREVER), CW_NEVER);
    }
}

TEST(rates_differ)
{
    assert_true(cw_rate_equal(cw_rate_of(160), cw_rate_of(160)));
    assert_false(cw_rate_equal(cw_rate_of(160), cw_rate_of(161)));
}

TEST(a_bus_tells_when_bits_to_come_will_have_passed)
{
    RIG *r = rig_new(2);
    rig_start(r);
    for (uint64_t bits = 0; bits < 10; bits++) {
        const uint64_t tick = cw_bus_tick_after(r->bus, bits);
        assert_int_equal(tick, cw_bus_now(r->bus) + bits * BIT);
        assert_int_equal(cw_bus_advance(r->bus, tick), CW_OK);
        assert_int_equal(cw_bus_now(r->bus), tick);
    }
    assert_int_equal(cw_bus_tick_after(r->bus, CW_BITS_FOREVER), CW_NEVER);
}

TEST(time_does_not_begin_again_at_its_end)
{
    const cw_wire_time t = at_bit(160, FAR);
    const uint64_t last = (CW_NEVER - FAR * 160 - 1) / 160;
    assert_int_equal(cw_after(CW_NEVER - 2, 1), CW_NEVER - 1);
    assert_int_equal(cw_after(CW_NEVER - 1, 1), CW_NEVER);
    assert_int_equal(cw_after(CW_NEVER - 1, 2), CW_NEVER);
    assert_int_equal(cw_after(CW_NEVER, CW_NEVER), CW_NEVER);
    assert_int_equal(cw_wire_tick_or_never(&t, last), (FAR + last) * 160);
    assert_int_equal(cw_wire_tick_or_never(&t, last + 1), CW_NEVER);
    assert_int_equal(cw_wire_tick_or_never(&t, CW_NEVER / 160 + 1), CW_NEVER);
    assert_int_equal(cw_wire_tick_or_never(&t, CW_BITS_FOREVER), CW_NEVER);
}

/* ---- The wire -------------------------------------------------------------------------------- */

TEST(the_wire_goes_from_bit_to_bit)
{
    for (unsigned i = 0; i < RATES; i++) {
        cw_wire_time t = at_bit(rates[i], 0);
        assert_int_equal(cw_wire_now(&t), 0);
        cw_wire_pass(&t, FAR);
        assert_int_equal(cw_wire_now(&t), (uint64_t)FAR * rates[i]);
        assert_int_equal(cw_wire_bit_end(&t), (FAR + UINT64_C(1)) * rates[i]);
        assert_int_equal(cw_wire_tick(&t, 7), (FAR + UINT64_C(7)) * rates[i]);
        assert_true(cw_rate_equal(cw_wire_rate(&t), cw_rate_of(rates[i])));
    }
}

TEST(bits_fit_until_the_tick_at_which_they_end)
{
    const cw_wire_time t = at_bit(160, FAR);
    const uint64_t now = cw_wire_now(&t);
    assert_true(cw_wire_fits(&t, 0, now));
    assert_true(cw_wire_fits(&t, 3, now + 3 * 160));
    assert_false(cw_wire_fits(&t, 3, now + 3 * 160 - 1));
    assert_true(cw_wire_fits(&t, 3, CW_NEVER));
    assert_false(cw_wire_fits_bit(&t, 0));
    assert_false(cw_wire_fits_bit(&t, now - 1));
    assert_false(cw_wire_fits_bit(&t, now + 159));
    assert_true(cw_wire_fits_bit(&t, now + 160));
}

TEST(no_bit_fits_behind_the_end_of_time)
{
    const cw_wire_time t = at_bit(160, CW_NEVER / 160);
    assert_false(cw_wire_fits_bit(&t, CW_NEVER));
}

TEST(bits_up_to_a_tick)
{
    const cw_wire_time t = at_bit(160, FAR);
    const uint64_t now = cw_wire_now(&t);
    const struct {
        uint64_t tick, before, until;
    } cases[] = {{0, 0, 0}, {now - 1, 0, 0}, {now, 0, 0}, {now + 1, 0, 1}, {now + 159, 0, 1},
                 {now + 160, 1, 1}, {now + 161, 1, 2}, {now + 1600, 10, 10},
                 {CW_NEVER, CW_BITS_FOREVER, CW_BITS_FOREVER}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(cw_wire_bits_before(&t, cases[i].tick), cases[i].before);
        assert_int_equal(cw_wire_bits_until(&t, cases[i].tick), cases[i].until);
        if (cases[i].tick >= now && cases[i].tick != CW_NEVER)
            assert_int_equal(cw_wire_bits_to(&t, cases[i].tick), cases[i].before);
    }
    assert_int_equal(cw_wire_bits_to(&t, CW_NEVER), (CW_NEVER - now) / 160);
}

/* ---- A frame on the wire --------------------------------------------------------------------- */

/* SOF begins at bit 20. In the middle of the frame its bits begin where they did at its start. */
TEST(a_frame_tells_when_its_bits_begin)
{
    RIG *r = rig_new(2);
    const cw_frame frame = rig_frame(0x123, 0, 2);
    rig_start(r);
    rig_send(r, 0, &frame, 20 * BIT);
    for (unsigned n = 1; n < 40; n++) {
        rig_run_bits(r, 20 + n);
        if (!r->bus->frame_step.active)
            continue;
        const unsigned at = r->bus->frame_step.at;
        assert_int_equal(cw_frame_step_tick(r->bus, at), cw_now(r->bus));
        for (unsigned bit = at; bit < r->bus->frame_step.length; bit++)
            assert_int_equal(cw_frame_step_tick(r->bus, bit), (20 + bit) * BIT);
    }
    assert_true(r->bus->frame_step.active);
}
