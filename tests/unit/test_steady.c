/* SPDX-License-Identifier: MIT
 *
 * test_steady.c - a controller that takes several bits at once reaches the same state as one by
 * one. It reports nothing in them, and its level changes only where its flag ends.
 */
#include "cases.h"
#include "format/bits.h"
#include "mac/mac.h"

#define WALKS 4000
#define WALK_BITS 400
#define LOOK_BITS 40
#define FD_FRAMES 50 /* with each protocol */
#define POINTS 400

static uint64_t draw(uint64_t *state)
{
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return *state >> 24;
}

/* Compares all that a controller carries into the next bit. */
static void assert_same(const cw_mac *a, const cw_mac *b)
{
    assert_int_equal(a->phase, b->phase);
    assert_int_equal(a->role, b->role);
    assert_int_equal(a->groups, b->groups);
    assert_int_equal(a->overloads_in_row, b->overloads_in_row);
    assert_int_equal(a->ack_deferred, b->ack_deferred);
    assert_int_equal(a->confinement.tec, b->confinement.tec);
    assert_int_equal(a->confinement.rec, b->confinement.rec);
    if (a->phase != CW_MAC_IDLE)
        assert_int_equal(a->count, b->count);
    if (a->phase == CW_MAC_ERROR_PASSIVE && a->count > 0)
        assert_int_equal(a->last, b->last);
    if (a->phase == CW_MAC_FRAME && a->role == CW_ROLE_RECEIVER)
        assert_true(cw_mac_same_point(a, b));
}

/* Takes so many bits of a level one by one, all of them steadily; returns their number. */
static uint64_t take_one_by_one(cw_mac *m, bool level, uint64_t bits)
{
    const unsigned holds = cw_mac_holds_wire(m);
    cw_mac_report report;
    for (uint64_t n = 0; n < bits; n++) {
        bool driven = cw_mac_drive(m);
        assert_int_equal(driven, n < holds ? CW_DOMINANT : CW_RECESSIVE);
        cw_mac_sample(m, level, &report);
        assert_int_equal(report.what, 0);
    }
    return bits;
}

/* Copies a controller with its part for FD frames. */
static void copy(cw_mac *to, cw_fd_part *part, const cw_mac *from)
{
    *to = *from;
    if (!from->fd)
        return;
    *part = *from->fd;
    to->fd = part;
}

/* Returns how many bits it was steady, for the test to know that it saw something. */
static uint64_t compare(const cw_mac *m, bool level)
{
    uint64_t bits = cw_mac_steady_bits(m, level);
    if (cw_mac_holds_wire(m) && level)
        return 0; /* another node changes the wire: nothing is skipped */
    bits = bits < LOOK_BITS ? bits : LOOK_BITS;
    for (uint64_t part = 1; part <= bits; part++) {
        cw_mac slow, fast;
        cw_fd_part slow_part, fast_part;
        copy(&slow, &slow_part, m);
        copy(&fast, &fast_part, m);
        (void)take_one_by_one(&slow, level, part);
        cw_mac_skip(&fast, part, level);
        assert_same(&fast, &slow);
    }
    return bits;
}

static cw_mac random_controller(uint64_t *seed)
{
    static const uint8_t modes[] = {0, 0, 0, CW_MODE_LISTEN_ONLY, CW_MODE_LOOPBACK,
                                    CW_MODE_ONE_SHOT};
    static const uint16_t counters[] = {0, 0, 90, 127, 130, 250};
    cw_mac m;
    cw_mac_report report;
    cw_mac_init(&m, modes[draw(seed) % 6], 96);
    assert_int_equal(cw_mac_set_counters(&m, counters[draw(seed) % 6], counters[draw(seed) % 5]),
                     CW_OK);
    for (unsigned i = 0; i < CW_INTEGRATION_BITS; i++) {
        (void)cw_mac_drive(&m);
        cw_mac_sample(&m, CW_RECESSIVE, &report);
    }
    return m;
}

/* Calls the controller from time to time, as a host does. */
static void disturb(cw_mac *m, uint64_t *seed)
{
    const cw_frame frame = {.id = (uint32_t)draw(seed) & 0x7FF, .dlc = (uint8_t)(draw(seed) % 3)};
    if (draw(seed) % 30 == 0)
        (void)cw_mac_offer(m, &frame);
    if (draw(seed) % 60 == 0)
        (void)cw_mac_request_overload(m, 1 + (unsigned)(draw(seed) % 2));
    if (draw(seed) % 60 == 0)
        (void)cw_mac_request_restart(m);
    if (draw(seed) % 200 == 0)
        (void)cw_mac_force_error(m);
    if (draw(seed) % 200 == 0)
        cw_mac_sleep(m);
    if (draw(seed) % 60 == 0)
        cw_mac_wake(m);
}

TEST(steady_bits_can_be_taken_at_once)
{
    uint64_t seed = 1;
    uint64_t steady[CW_MAC_PHASE_COUNT][2] = {{0}};
    for (unsigned walk = 0; walk < WALKS; walk++) {
        cw_mac m = random_controller(&seed);
        uint64_t change = 2 + draw(&seed) % 12; /* long runs in some walks */
        bool level = CW_RECESSIVE;
        for (unsigned bit = 0; bit < WALK_BITS; bit++) {
            cw_mac_report report;
            disturb(&m, &seed);
            steady[m.phase][0] += compare(&m, CW_DOMINANT);
            steady[m.phase][1] += compare(&m, CW_RECESSIVE);
            level = draw(&seed) % change == 0 ? !level : level;
            bool driven = cw_mac_drive(&m);
            cw_mac_sample(&m, draw(&seed) % 40 ? level && driven : level, &report);
        }
    }
    const unsigned in_both[] = {CW_MAC_FRAME,        CW_MAC_ERROR_PASSIVE, CW_MAC_ERROR_WAIT,
                                CW_MAC_OVERLOAD_WAIT, CW_MAC_BUS_OFF,      CW_MAC_RECOVERING,
                                CW_MAC_ASLEEP};
    for (unsigned i = 0; i < sizeof in_both / sizeof in_both[0]; i++) {
        assert_int_not_equal(steady[in_both[i]][0], 0);
        assert_int_not_equal(steady[in_both[i]][1], 0);
    }
    assert_int_not_equal(steady[CW_MAC_ERROR_ACTIVE][0], 0);
    assert_int_not_equal(steady[CW_MAC_OVERLOAD_FLAG][0], 0);
    assert_int_not_equal(steady[CW_MAC_ERROR_DELIMITER][1], 0);
    assert_int_not_equal(steady[CW_MAC_OVERLOAD_DELIMITER][1], 0);
    assert_int_not_equal(steady[CW_MAC_INTERMISSION][1], 0);
    assert_int_not_equal(steady[CW_MAC_SUSPEND][1], 0);
}

/* ---- FD frames ------------------------------------------------------------------------------- */

static cw_frame random_fd_frame(uint64_t *seed)
{
    static const uint8_t bytes[] = {0, 0xFF, 0x07, 0xF8, 0x55};
    const unsigned flags = CW_FRAME_FD | (draw(seed) % 2 ? CW_FRAME_BRS : 0) |
                           (draw(seed) % 2 ? CW_FRAME_EXTENDED : 0) |
                           (draw(seed) % 2 ? CW_FRAME_ESI : 0);
    cw_frame f = {.flags = (uint8_t)flags, .dlc = draw(seed) % 16};
    f.id = (uint32_t)draw(seed) & (flags & CW_FRAME_EXTENDED ? CW_EXTENDED_ID_MAX : CW_BASE_ID_MAX);
    for (unsigned i = 0; i < CW_FRAME_DATA_MAX; i++)
        f.data[i] = bytes[draw(seed) % sizeof bytes];
    return f;
}

static void begin_fd(cw_mac *m, cw_fd_part *part, unsigned protocol)
{
    cw_mac_report report;
    const bool knows = (protocol & CW_PROTOCOL_MASK) == CW_FD;
    cw_mac_init(m, 0, 96);
    assert_int_equal(cw_mac_set_protocol(m, protocol, knows ? part : NULL), CW_OK);
    for (unsigned i = 0; i < CW_INTEGRATION_BITS; i++)
        cw_mac_sample(m, cw_mac_drive(m), &report);
}

/* Takes a frame, with a wrong bit in some, and compares before each bit. Returns the steady bits
 * inside the frame. */
static uint64_t walk_frame(cw_mac *m, const cw_frame *frame, uint64_t *seed)
{
    cw_bits bits;
    uint64_t steady = 0;
    assert_int_equal(cw_bits_encode(&bits, frame), CW_OK);
    const unsigned wrong = (unsigned)draw(seed) % (4u * bits.length);
    for (unsigned n = 0; n < bits.length + 20u; n++) {
        cw_mac_report report;
        const bool in_frame = m->phase == CW_MAC_FRAME;
        const uint64_t both = compare(m, CW_DOMINANT) + compare(m, CW_RECESSIVE);
        steady += in_frame ? both : 0;
        const bool level = n >= bits.length || cw_bits_level(&bits, n) != (n == wrong);
        cw_mac_sample(m, cw_mac_drive(m) && level, &report);
    }
    return steady;
}

TEST(steady_bits_of_fd_frames_can_be_taken_at_once)
{
    static const unsigned protocols[] = {CW_FD, CW_FD | CW_PROTOCOL_NON_ISO, CW_FD_TOLERANT,
                                         CW_CLASSICAL};
    uint64_t seed = 2;
    for (unsigned p = 0; p < 4; p++) {
        cw_mac m;
        cw_fd_part part;
        uint64_t steady = 0;
        begin_fd(&m, &part, protocols[p]);
        for (unsigned i = 0; i < FD_FRAMES; i++) {
            cw_frame frame = random_fd_frame(&seed);
            frame.flags |= protocols[p] & CW_PROTOCOL_NON_ISO ? CW_FRAME_NON_ISO : 0;
            steady += walk_frame(&m, &frame, &seed);
        }
        assert_int_not_equal(steady, 0);
    }
}

/* ---- Points ---------------------------------------------------------------------------------- */

static void take_bits(cw_mac *m, const cw_bits *bits, unsigned count)
{
    cw_mac_report report;
    for (unsigned n = 0; n < count; n++)
        cw_mac_sample(m, cw_mac_drive(m) && (n >= bits->length || cw_bits_level(bits, n)), &report);
}

/* Whatever both have received before, and then take the rest of the frame alike. */
TEST(controllers_at_one_point_stay_together)
{
    uint64_t seed = 3;
    for (unsigned i = 0; i < POINTS; i++) {
        cw_mac a, b;
        cw_fd_part a_part, b_part;
        cw_bits before, bits;
        const cw_frame longer = random_fd_frame(&seed), frame = random_fd_frame(&seed);
        assert_int_equal(cw_bits_encode(&before, &longer), CW_OK);
        assert_int_equal(cw_bits_encode(&bits, &frame), CW_OK);
        begin_fd(&a, &a_part, CW_FD);
        begin_fd(&b, &b_part, CW_FD);
        take_bits(&a, &before, before.length + 3u);
        const unsigned n = 1 + (unsigned)draw(&seed) % (bits.length - 1u);
        const cw_stuffing stuffing = cw_bits_stuffing(&bits);
        cw_mac_go_into_frame(&b, &frame, &bits, &stuffing, n);
        cw_mac_go_to_point(&a, &b);
        for (unsigned k = n; k < bits.length; k++) {
            cw_mac_report report;
            assert_true(cw_mac_same_point(&a, &b));
            const bool level = cw_mac_drive(&a) && cw_bits_level(&bits, k);
            assert_int_equal(cw_mac_drive(&b), a.driven);
            cw_mac_sample(&a, level, &report);
            cw_mac_sample(&b, level, &report);
        }
        assert_true(cw_frame_equal(cw_mac_received(&a), &frame));
        assert_int_equal(cw_mac_get_phase(&a), CW_MAC_INTERMISSION);
    }
}
