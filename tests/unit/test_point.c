/* SPDX-License-Identifier: MIT
 *
 * test_point.c - a controller put into the middle of a frame is where a receiver comes by its bits.
 */
#include "cases.h"
#include "format/bits.h"
#include "mac/mac.h"

#define FRAMES 2000

static uint64_t draw(uint64_t *state)
{
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *state >> 24;
}

static cw_frame random_frame(uint64_t *state)
{
    uint64_t r = draw(state);
    cw_frame f = {.flags = r & (CW_FRAME_EXTENDED | CW_FRAME_REMOTE), .dlc = (r >> 2) & 15};
    f.id = (uint32_t)draw(state) & (f.flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu);
    if (draw(state) % 4 == 0)
        f.id = 0; /* long runs */
    uint64_t data = draw(state) % 3 ? draw(state) << 20 | draw(state) : 0;
    for (unsigned i = 0; i < 8; i++)
        f.data[i] = (uint8_t)(data >> (8 * i));
    return f;
}

static cw_mac idle_receiver(void)
{
    cw_mac m;
    cw_mac_report report;
    cw_mac_init(&m, 0, 96);
    for (unsigned i = 0; i < CW_INTEGRATION_BITS; i++) {
        (void)cw_mac_drive(&m);
        cw_mac_sample(&m, CW_RECESSIVE, &report);
    }
    assert_int_equal(cw_mac_get_phase(&m), CW_MAC_IDLE);
    return m;
}

static void take(cw_mac *m, const cw_bits *bits, unsigned n)
{
    const unsigned ack_slot = bits->length - 9u;
    cw_mac_report report;
    bool level = n >= bits->length || cw_bits_level(bits, n);
    (void)cw_mac_drive(m);
    cw_mac_sample(m, n == ack_slot ? CW_DOMINANT : level, &report);
}

static void assert_same_point(const cw_mac *a, const cw_mac *b, const cw_bits *bits, unsigned n)
{
    if (n < bits->length) {
        assert_true(cw_mac_same_point(a, b));
        return;
    }
    assert_int_equal(a->phase, b->phase);
    assert_int_equal(a->count, b->count);
    assert_int_equal(a->role, b->role);
}

TEST(a_point_in_a_frame_is_where_its_bits_lead_to)
{
    uint64_t seed = 1;
    for (unsigned i = 0; i < FRAMES; i++) {
        const cw_frame frame = random_frame(&seed);
        cw_bits bits;
        assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
        cw_mac stepped = idle_receiver();
        for (unsigned n = 1; n <= bits.length + 2u; n++) {
            cw_mac placed = idle_receiver();
            take(&stepped, &bits, n - 1);
            const cw_stuffing stuffing = cw_bits_stuffing(&bits);
            cw_mac_go_into_frame(&placed, &frame, &bits, &stuffing, n);
            assert_same_point(&placed, &stepped, &bits, n);
        }
    }
}
