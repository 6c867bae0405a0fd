/* SPDX-License-Identifier: MIT
 *
 * fuzz_mac.c - one controller and a bench with any levels and any commands, at any time. State,
 * counters, phase and reports must agree after every bit.
 *
 * Input: mode byte, warning limit, then operations. A byte below 0x80 is seven bits of a bus that
 * others may only pull dominant. A byte below 0xC0 is six bits of any level; above that it is a
 * command.
 */
#include "fuzz.h"

#define TEC_MAX 263u
#define REC_MAX 255u
#define PASSIVE_LIMIT 128u
#define BUS_OFF_LIMIT 256u
#define BITS_MAX 20000u
#define ANY_LEVEL 0x80u
#define COMMAND 0xC0u

typedef struct bench {
    cw_mac mac;
    cw_mac_report report;
    fuzz_input in;
    cw_state told; /* the last state that was reported */
    unsigned warning_limit;
    unsigned bits;
    bool offered; /* a frame whose result has not been reported yet */
    bool cut;     /* disconnected */
} bench;

/* ---- What must hold -------------------------------------------------------------------------- */

static bool is_off(const cw_mac *m)
{
    cw_mac_phase phase = cw_mac_get_phase(m);
    return phase == CW_MAC_BUS_OFF || phase == CW_MAC_RECOVERING;
}

static cw_state state_of(unsigned tec, unsigned rec, unsigned warning_limit)
{
    unsigned worst = tec > rec ? tec : rec;
    if (tec >= BUS_OFF_LIMIT)
        return CW_STATE_BUS_OFF;
    if (worst >= PASSIVE_LIMIT)
        return CW_STATE_ERROR_PASSIVE;
    return worst >= warning_limit ? CW_STATE_ERROR_WARNING : CW_STATE_ERROR_ACTIVE;
}

static void check_state(const bench *b)
{
    const cw_mac *m = &b->mac;
    unsigned tec = cw_mac_tec(m);
    unsigned rec = cw_mac_rec(m);
    REQUIRE(tec <= TEC_MAX && rec <= REC_MAX);
    REQUIRE(cw_mac_state(m) == state_of(tec, rec, b->warning_limit));
    REQUIRE(is_off(m) == (cw_mac_state(m) == CW_STATE_BUS_OFF));
    REQUIRE(cw_mac_get_phase(m) < CW_MAC_PHASE_COUNT);
    REQUIRE(cw_mac_get_phase(m) != CW_MAC_OFF || b->cut);
    REQUIRE(cw_mac_place(m).field < CW_FIELD_STUFF);
    REQUIRE(!is_off(m) || (!cw_mac_can_start(m) && !cw_mac_is_sending(m)));
    REQUIRE(!cw_mac_is_sending(m) ||
            (cw_mac_get_phase(m) == CW_MAC_FRAME && cw_mac_role(m) == CW_ROLE_TRANSMITTER));
}

/* R1..R8: a counter moves by these steps only, in a bit without other changes of it. */
static bool tec_step_allowed(unsigned before, unsigned after)
{
    return after == before || after == before + 8 || after + 1 == before;
}

static bool rec_step_allowed(unsigned before, unsigned after)
{
    bool capped = after == REC_MAX && before + 8 >= REC_MAX;
    bool passive = before >= PASSIVE_LIMIT && after >= 119 && after < PASSIVE_LIMIT; /* R8 */
    return after == before || after == before + 1 || after == before + 8 || after + 1 == before ||
           capped || passive;
}

static void check_counters(const bench *b, const cw_mac *before)
{
    const cw_mac *m = &b->mac;
    bool moved = cw_mac_tec(m) != cw_mac_tec(before) || cw_mac_rec(m) != cw_mac_rec(before);
    if (is_off(before) && !is_off(m)) { /* R12 */
        REQUIRE(cw_mac_tec(m) == 0 && cw_mac_rec(m) == 0);
        return;
    }
    REQUIRE(!moved || !(m->modes & CW_MODE_LISTEN_ONLY));
    REQUIRE(tec_step_allowed(cw_mac_tec(before), cw_mac_tec(m)));
    REQUIRE(rec_step_allowed(cw_mac_rec(before), cw_mac_rec(m)));
}

static void check_error(const bench *b, const cw_mac *before)
{
    const cw_error *e = &b->report.error;
    bool passive = cw_mac_tec(before) >= PASSIVE_LIMIT || cw_mac_rec(before) >= PASSIVE_LIMIT;
    REQUIRE(e->type < CW_ERROR_COUNT && e->place.field != CW_FIELD_NONE);
    REQUIRE((e->flag == CW_FLAG_NONE) == is_off(&b->mac));
    REQUIRE(e->flag == CW_FLAG_NONE || passive == (e->flag == CW_FLAG_PASSIVE));
    REQUIRE(e->role != CW_ROLE_NONE);
}

static void check_drop(const bench *b, const cw_mac *before)
{
    bool one_shot = b->report.why == CW_DROP_ONE_SHOT;
    REQUIRE(one_shot || b->report.why == CW_DROP_BUS_OFF);
    if (one_shot)
        REQUIRE((b->mac.modes & CW_MODE_ONE_SHOT) && cw_mac_is_sending(before) &&
                !cw_mac_is_sending(&b->mac));
    else
        REQUIRE(is_off(&b->mac));
}

static void check_report(bench *b, const cw_mac *before)
{
    const cw_mac_report *r = &b->report;
    cw_state state = cw_mac_state(&b->mac);
    REQUIRE(((r->what & CW_REPORT_STATE) != 0) == (state != b->told));
    b->told = state;
    if (r->what & CW_REPORT_ERROR)
        check_error(b, before);
    if (r->what & CW_REPORT_RX)
        REQUIRE(cw_frame_valid(cw_mac_received(&b->mac)));
    if (r->what & (CW_REPORT_TX | CW_REPORT_ARBITRATION_LOST))
        REQUIRE(cw_mac_is_sending(before) && !cw_mac_is_sending(&b->mac));
    if (r->what & (CW_REPORT_TX | CW_REPORT_DROPPED))
        REQUIRE(b->offered);
    if (r->what & CW_REPORT_DROPPED)
        check_drop(b, before);
    if (r->what & (CW_REPORT_TX | CW_REPORT_DROPPED))
        b->offered = false;
    REQUIRE(b->mac.offered == b->offered);
    if (r->what & CW_REPORT_TX)
        REQUIRE(!(r->what & (CW_REPORT_ERROR | CW_REPORT_ARBITRATION_LOST | CW_REPORT_DROPPED)));
    if (r->what & CW_REPORT_ARBITRATION_LOST)
        REQUIRE(r->lost_bit <= 31);
}

static void check_drive(const cw_mac *before, const cw_mac *after, bool own)
{
    bool could = before->offered && cw_mac_can_start(before);
    REQUIRE(after->started == could);
    REQUIRE(own || !(after->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK)));
    switch (cw_mac_get_phase(after)) {
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
        REQUIRE(after->driven == CW_DOMINANT);
        break;
    case CW_MAC_FRAME:
        break;
    case CW_MAC_OFF:
    case CW_MAC_INTEGRATING:
    case CW_MAC_IDLE:
    case CW_MAC_ERROR_PASSIVE:
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_WAIT:
    case CW_MAC_OVERLOAD_DELIMITER:
    case CW_MAC_INTERMISSION:
    case CW_MAC_SUSPEND:
    case CW_MAC_BUS_OFF:
    case CW_MAC_ASLEEP:
    case CW_MAC_RECOVERING:
    case CW_MAC_PHASE_COUNT:
        REQUIRE(own == CW_RECESSIVE);
        break;
    }
}

/* ---- Bits ------------------------------------------------------------------------------------ */

/* Plays one bit, in which others pull the bus to a level, or (any) the level is forced. */
static void bit(bench *b, bool level, bool any)
{
    cw_mac before = b->mac;
    bool own = cw_mac_drive(&b->mac);
    check_drive(&before, &b->mac, own);
    before = b->mac;
    cw_mac_sample(&b->mac, any ? level : own && level, &b->report);
    check_state(b);
    check_counters(b, &before);
    check_report(b, &before);
    b->bits++;
}

static void bits(bench *b, unsigned levels, unsigned count, bool any)
{
    for (unsigned i = 0; i < count; i++)
        bit(b, levels >> i & 1u, any);
}

/* Plays a foreign frame, which the controller may get, join or beat; up to a bit of it. */
static void foreign_frame(bench *b)
{
    cw_bits wire;
    const cw_frame frame = fuzz_frame(&b->in);
    unsigned end = fuzz_u8(&b->in);
    if (cw_bits_encode(&wire, &frame) != CW_OK)
        return;
    for (unsigned i = 0; i < wire.length && i != end; i++)
        bit(b, cw_bits_level(&wire, i), false);
}

/* ---- Commands -------------------------------------------------------------------------------- */

static void offer(bench *b)
{
    const cw_frame frame = fuzz_frame(&b->in);
    bool refused =
        is_off(&b->mac) || cw_mac_is_sending(&b->mac) || (b->mac.modes & CW_MODE_LISTEN_ONLY);
    cw_status wanted = cw_frame_valid(&frame) ? CW_OK : CW_INVALID;
    REQUIRE(cw_mac_offer(&b->mac, &frame) == (refused ? CW_REFUSED : wanted));
    b->offered = b->offered || (!refused && wanted == CW_OK);
}

static void set_counters(bench *b)
{
    unsigned tec = fuzz_below(&b->in, 300);
    unsigned rec = fuzz_below(&b->in, 300);
    bool valid = tec <= TEC_MAX && rec <= REC_MAX;
    REQUIRE(cw_mac_set_counters(&b->mac, tec, rec) == (valid ? CW_OK : CW_INVALID));
    if (valid)
        REQUIRE(cw_mac_tec(&b->mac) == tec && cw_mac_rec(&b->mac) == rec);
}

static void request_restart(bench *b)
{
    bool possible = cw_mac_get_phase(&b->mac) == CW_MAC_BUS_OFF;
    REQUIRE(cw_mac_request_restart(&b->mac) == (possible ? CW_OK : CW_REFUSED));
}

static void withdraw(bench *b)
{
    bool sending = cw_mac_is_sending(&b->mac);
    REQUIRE(cw_mac_withdraw(&b->mac) == (sending ? CW_REFUSED : CW_OK));
    b->offered = b->offered && sending;
}

static void command(bench *b, unsigned what)
{
    switch (what) {
    case 0:
        offer(b);
        break;
    case 1:
        foreign_frame(b);
        break;
    case 2:
        bits(b, 0xFFFF, 12, false);
        break;
    case 3:
        bits(b, 0, fuzz_below(&b->in, 32), false);
        break;
    case 4:
        set_counters(b);
        break;
    case 5:
        cw_mac_set_modes(&b->mac, fuzz_u8(&b->in) & 0x1Fu);
        break;
    case 6:
        (void)cw_mac_request_overload(&b->mac, fuzz_below(&b->in, 4));
        break;
    case 7:
        request_restart(b);
        break;
    case 8:
        withdraw(b);
        break;
    case 9: /* long enough for R12 */
        for (unsigned i = 0; i < 128 * 11; i++)
            bit(b, CW_RECESSIVE, false);
        break;
    case 10: /* the bench is silent: the controller alone, with an ACK now and then */
        for (unsigned i = fuzz_u8(&b->in); i > 0; i--)
            bit(b, cw_mac_place(&b->mac).field != CW_FIELD_ACK_SLOT, false);
        break;
    case 12:
        b->cut = true;
        cw_mac_disconnect(&b->mac);
        break;
    case 13:
        b->cut = false;
        cw_mac_reconnect(&b->mac);
        REQUIRE(cw_mac_get_phase(&b->mac) != CW_MAC_OFF);
        break;
    case 14:
        if (fuzz_u8(&b->in) % 2)
            cw_mac_sleep(&b->mac);
        else
            cw_mac_wake(&b->mac);
        break;
    default:
        bit(b, CW_RECESSIVE, false);
        break;
    }
    check_state(b);
    REQUIRE(b->mac.offered == b->offered);
}

/* Returns a command. The last four of the 64 were added later, so that old inputs keep their
 * meaning. */
static unsigned command_of(unsigned op)
{
    unsigned number = op - COMMAND;
    return number < 60 ? number % 12 : 12 + number % 2;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    bench b = {.in = {.data = data, .left = size}};
    unsigned modes = fuzz_u8(&b.in) & 0x1Fu;
    b.warning_limit = 1 + fuzz_below(&b.in, 255);
    cw_mac_init(&b.mac, modes, b.warning_limit);
    while (b.in.left > 0 && b.bits < BITS_MAX) {
        unsigned op = fuzz_u8(&b.in);
        if (op >= COMMAND)
            command(&b, command_of(op));
        else if (op >= ANY_LEVEL)
            bits(&b, op, 6, true);
        else
            bits(&b, op, 7, false);
    }
    return 0;
}
