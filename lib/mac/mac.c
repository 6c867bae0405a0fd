/* SPDX-License-Identifier: MIT
 *
 * mac.c - one CAN controller, bit by bit (rules M, E, O and R of RULES.md).
 *
 * A bit has two phases. cw_mac_drive() returns the level that the controller puts on the wire.
 * cw_mac_sample() takes the level of the wire and goes on to the next bit. Each phase of the
 * controller has one sample function. Inside a frame the controller walks the table of parts
 * (format/parts.h) by the levels that it samples. Checks that hold for every bit come first; the
 * effect of a part comes at its end. A transmitter parses its own frame as the receivers do, so
 * that it can become a receiver in any bit (M2).
 */
#include "mac/mac_private.h"

#include "mac/confinement.h"
#include "format/bits.h"
#include "format/crc.h"
#include "format/parts.h"
#include "format/tables.h"

#include <assert.h>
#include <string.h>

/* All reports. Those who look at one must not see another: two with a bit in common have a sum that
 * is not their union. scripts/check finds one that is missing here. */
#define ALL_REPORTS(op)                                                                            \
    (CW_REPORT_STARTED op CW_REPORT_ARBITRATION_LOST op CW_REPORT_ERROR op CW_REPORT_OVERLOAD op   \
     CW_REPORT_RX op CW_REPORT_TX op CW_REPORT_STATE op CW_REPORT_DROPPED op CW_REPORT_EXCEPTION   \
     op CW_REPORT_TOLERATED op CW_REPORT_SLEEP op CW_REPORT_WAKE op CW_REPORT_ARBITRATION_WON)
_Static_assert(ALL_REPORTS(+) == ALL_REPORTS(|), "each report has a bit of its own");
_Static_assert(ALL_REPORTS(|) <= UINT16_MAX, "cw_mac_report.what has all of them");

/* ---- Set-up and what the host asks for ------------------------------------------------------- */

void cw_mac_integrate(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    m->groups = 0;
    cw_mac_enter(m, m->sleeps ? CW_MAC_ASLEEP : CW_MAC_INTEGRATING);
}

void cw_mac_init(cw_mac *m, unsigned modes, unsigned warning_limit)
{
    memset(m, 0, sizeof *m);
    m->confinement.warning_limit = (uint16_t)warning_limit;
    m->driven = CW_RECESSIVE;
    cw_mac_set_modes(m, modes);
    cw_mac_integrate(m);
}

static bool is_bus_off(const cw_mac *m)
{
    return m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_RECOVERING;
}

void cw_mac_set_modes(cw_mac *m, unsigned modes)
{
    const unsigned wire_modes = CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK | CW_MODE_RESTRICTED;
    bool leaves = (m->modes ^ modes) & wire_modes;
    m->modes = (uint8_t)modes;
    m->confinement.frozen = modes & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED);
    if (leaves && m->phase != CW_MAC_OFF && !is_bus_off(m))
        cw_mac_integrate(m);
}

void cw_mac_sleep(cw_mac *m)
{
    m->sleeps = true;
    if (m->phase == CW_MAC_IDLE || m->phase == CW_MAC_INTEGRATING)
        cw_mac_integrate(m);
}

void cw_mac_wake(cw_mac *m)
{
    m->sleeps = false;
    if (m->phase == CW_MAC_ASLEEP)
        cw_mac_integrate(m);
}

bool cw_wake_filter_take(cw_wake_filter *f, bool level, uint64_t time)
{
    f->dominant = level ? 0 : cw_after(f->dominant, time);
    return level == CW_DOMINANT && f->dominant >= f->length;
}

bool cw_mac_is_on_bus(const cw_mac *m)
{
    return m->phase != CW_MAC_OFF && m->phase != CW_MAC_ASLEEP && !is_bus_off(m);
}

bool cw_protocol_valid(unsigned protocol)
{
    const unsigned old = protocol & (CW_PROTOCOL_2_0A | CW_PROTOCOL_2_0B_PASSIVE);
    const unsigned frames = protocol & CW_PROTOCOL_MASK;
    const bool one = old == 0 || old == CW_PROTOCOL_2_0A || old == CW_PROTOCOL_2_0B_PASSIVE;
    return protocol <= UINT8_MAX && frames <= CW_FD && one && (!old || frames == CW_CLASSICAL);
}

cw_status cw_mac_set_protocol(cw_mac *m, unsigned protocol, cw_fd_part *fd)
{
    const bool knows_fd = (protocol & CW_PROTOCOL_MASK) == CW_FD;
    if (!cw_protocol_valid(protocol) || knows_fd != (fd != NULL))
        return CW_INVALID;
    m->protocol = (uint8_t)protocol;
    m->fd = fd;
    m->offered = false;
    memset(&m->rx, 0, sizeof m->rx);
    if (fd)
        memset(fd, 0, sizeof *fd);
    if (cw_mac_is_on_bus(m))
        cw_mac_integrate(m);
    return CW_OK;
}

cw_status cw_mac_set_variants(cw_mac *m, unsigned variants)
{
    if (variants & ~CW_VARIANTS_ALL)
        return CW_INVALID;
    m->no_high_ids = variants & CW_VARIANT_NO_HIGH_IDS;
    m->no_long_dlc = variants & CW_VARIANT_NO_LONG_DLC;
    m->confinement.holds_rec = variants & CW_VARIANT_REC_HOLDS;
    m->offered = m->offered && cw_mac_is_sending(m);
    return CW_OK;
}

void cw_mac_disconnect(cw_mac *m)
{
    if (is_bus_off(m))
        return;
    m->role = CW_ROLE_NONE;
    cw_mac_enter(m, CW_MAC_OFF);
}

void cw_mac_reconnect(cw_mac *m)
{
    if (m->phase == CW_MAC_OFF)
        cw_mac_integrate(m);
}

bool cw_mac_is_sending(const cw_mac *m)
{
    return cw_mac_sends(m);
}

bool cw_mac_can_start(const cw_mac *m)
{
    return cw_mac_may_start(m);
}

void cw_mac_encode(cw_mac *m, const cw_frame *frame, unsigned inverted)
{
    if (m->fd)
        cw_mac_fd_encode(m, frame, inverted);
    else
        (void)cw_bits_encode_crc((cw_bits *)(void *)&m->tx, frame, inverted);
}

cw_status cw_mac_offer(cw_mac *m, const cw_frame *frame)
{
    if (is_bus_off(m) || cw_mac_is_sending(m) || cw_mac_only_receives(m))
        return CW_REFUSED;
    if (!cw_mac_knows(m, frame))
        return CW_INVALID;
    cw_mac_encode(m, frame, 0);
    m->offered = true;
    return CW_OK;
}

cw_status cw_mac_withdraw(cw_mac *m)
{
    if (cw_mac_is_sending(m))
        return CW_REFUSED;
    m->offered = false;
    return CW_OK;
}

cw_status cw_mac_request_overload(cw_mac *m, unsigned frames)
{
    if (frames < 1 || frames > CW_OVERLOADS_MAX)
        return CW_INVALID;
    m->overloads_wanted = (uint8_t)frames;
    return CW_OK;
}

cw_status cw_mac_request_restart(cw_mac *m)
{
    if (m->phase != CW_MAC_BUS_OFF)
        return CW_REFUSED;
    m->groups = 0;
    cw_mac_enter(m, CW_MAC_RECOVERING);
    return CW_OK;
}

/* Gives up the frame on offer and reports the reason. */
static void drop_offer(cw_mac *m, cw_drop why, cw_mac_report *r)
{
    m->offered = false;
    r->what |= CW_REPORT_DROPPED;
    r->why = (unsigned)why & 0x7Fu;
}

/* Goes bus-off at once, whatever the controller was sending (R10). */
static void go_bus_off(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    m->waits_long = false; /* R12 is as long */
    cw_mac_enter(m, CW_MAC_BUS_OFF);
}

/* Carries out R10 after a counter has moved. Returns true when the controller went bus-off. */
static bool check_bus_off(cw_mac *m, cw_mac_report *r)
{
    if (m->confinement.state != CW_STATE_BUS_OFF)
        return false;
    go_bus_off(m);
    if (m->offered)
        drop_offer(m, CW_DROP_BUS_OFF, r);
    return true;
}

cw_status cw_mac_set_counters(cw_mac *m, unsigned tec, unsigned rec)
{
    if (tec > CW_TEC_MAX || rec > CW_REC_MAX)
        return CW_INVALID;
    bool was_off = m->confinement.state == CW_STATE_BUS_OFF;
    cw_confinement_set(&m->confinement, tec, rec);
    bool is_off = m->confinement.state == CW_STATE_BUS_OFF;
    if (is_off && !was_off) /* otherwise the controller goes on waiting or counting */
        go_bus_off(m);
    if (was_off && !is_off)
        cw_mac_integrate(m);
    return CW_OK;
}

void cw_mac_reset(cw_mac *m, bool hardware)
{
    const bool restarts = !hardware && is_bus_off(m);
    m->offered = false;
    m->overloads_wanted = 0;
    m->overloads_in_row = 0;
    m->ack_deferred = false;
    m->groups = 0;
    m->waits_long = !hardware && !restarts;
    if (restarts) {
        cw_mac_enter(m, CW_MAC_RECOVERING);
        return;
    }
    cw_confinement_reset(&m->confinement);
    if (m->phase != CW_MAC_OFF)
        cw_mac_integrate(m);
}

/* ---- Reading --------------------------------------------------------------------------------- */

unsigned cw_mac_tec(const cw_mac *m)
{
    return m->confinement.tec;
}

unsigned cw_mac_rec(const cw_mac *m)
{
    return m->confinement.rec;
}

cw_state cw_mac_state(const cw_mac *m)
{
    return (cw_state)m->confinement.state;
}

cw_mac_phase cw_mac_get_phase(const cw_mac *m)
{
    return (cw_mac_phase)m->phase;
}

cw_role cw_mac_role(const cw_mac *m)
{
    return (cw_role)m->role;
}

const cw_frame *cw_mac_received(const cw_mac *m)
{
    return m->fd ? &m->fd->rx : (const cw_frame *)(const void *)&m->rx;
}

/* A receiver cannot tell SRR from RTR before the IDE, so it takes the bit for an RTR. Nor can it
 * tell FDF from a reserved bit before it has sampled it. */
static cw_place frame_place(const cw_mac *m)
{
    const unsigned received = cw_mac_received(m)->flags;
    const bool sends = cw_mac_is_transmitter(m);
    const bool extended = sends ? cw_bits_is_extended(cw_mac_tx(m)) : received & CW_FRAME_EXTENDED;
    const bool fd = sends ? cw_bits_is_fd(cw_mac_tx(m)) : received & CW_FRAME_FD;
    if (!cw_mac_stuff_bit_due(m))
        return cw_part_place((cw_part)m->part, m->index, extended, fd);
    if (cw_mac_has_fixed_stuffing(m))
        return (cw_place){.field = CW_FIELD_FIXED_STUFF, .stuff = true, .extended = extended,
                          .index = (uint16_t)cw_mac_fd_fixed_number(m)};
    cw_place place = cw_part_place((cw_part)m->before_part, m->before_index, extended, fd);
    place.stuff = true;
    return place;
}

cw_place cw_mac_place(const cw_mac *m)
{
    static const cw_field fields[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_ERROR_ACTIVE] = CW_FIELD_ERROR_FLAG,
        [CW_MAC_ERROR_PASSIVE] = CW_FIELD_ERROR_FLAG,
        [CW_MAC_ERROR_WAIT] = CW_FIELD_ERROR_DELIMITER,
        [CW_MAC_ERROR_DELIMITER] = CW_FIELD_ERROR_DELIMITER,
        [CW_MAC_OVERLOAD_FLAG] = CW_FIELD_OVERLOAD_FLAG,
        [CW_MAC_OVERLOAD_WAIT] = CW_FIELD_OVERLOAD_DELIMITER,
        [CW_MAC_OVERLOAD_DELIMITER] = CW_FIELD_OVERLOAD_DELIMITER,
        [CW_MAC_INTERMISSION] = CW_FIELD_INTERMISSION,
        [CW_MAC_SUSPEND] = CW_FIELD_SUSPEND,
    };
    if (m->phase == CW_MAC_FRAME)
        return frame_place(m);
    bool waits = m->phase == CW_MAC_ERROR_WAIT || m->phase == CW_MAC_OVERLOAD_WAIT;
    cw_place place = {.field = fields[m->phase], .index = waits ? 0 : m->count};
    if (place.field == CW_FIELD_NONE)
        place.index = 0;
    return place;
}

bool cw_mac_is_busy(const cw_mac *m)
{
    return m->phase >= CW_MAC_FRAME && m->phase <= CW_MAC_INTERMISSION;
}

bool cw_mac_own_bit(const cw_mac *m, unsigned *n)
{
    if (!cw_mac_is_sending(m))
        return false;
    *n = m->tx_next;
    return true;
}

/* T4: everywhere between frames but in the first bit of the intermission. D12: after FDF. */
bool cw_mac_synchronises_hard(const cw_mac *m)
{
    static const bool between[CW_MAC_PHASE_COUNT] = {
        [CW_MAC_OFF] = true,     [CW_MAC_INTEGRATING] = true, [CW_MAC_IDLE] = true,
        [CW_MAC_SUSPEND] = true, [CW_MAC_BUS_OFF] = true,     [CW_MAC_RECOVERING] = true,
        [CW_MAC_ASLEEP] = true,
    };
    if (m->phase == CW_MAC_FRAME)
        return m->part == CW_PART_RES && !cw_mac_stuff_bit_due(m) && !cw_mac_is_transmitter(m);
    return between[m->phase] || (m->phase == CW_MAC_INTERMISSION && m->count > 0);
}

bool cw_mac_counts_edges(const cw_mac *m)
{
    const bool counts = m->phase == CW_MAC_INTEGRATING || m->phase == CW_MAC_RECOVERING;
    return counts && (m->protocol & CW_PROTOCOL_MASK) != CW_CLASSICAL;
}

void cw_mac_note_edge(cw_mac *m)
{
    const bool seen = cw_mac_visible(m, CW_DOMINANT) == CW_DOMINANT; /* not in loopback */
    if (seen && cw_mac_counts_edges(m))
        m->count = 0;
}

/* ---- Drive ----------------------------------------------------------------------------------- */

void cw_mac_begin_frame(cw_mac *m, cw_role role)
{
    cw_mac_enter(m, CW_MAC_FRAME);
    m->role = (uint8_t)role;
    m->part = CW_PART_SOF;
    m->part_bits = cw_parts[CW_PART_SOF].bits;
    m->index = 0;
    m->run = 0;
    m->last = CW_RECESSIVE; /* the level before SOF, which is dominant */
    m->crc = 0;
    m->overloads_in_row = 0;
    if (m->fd)
        cw_mac_fd_begin(m);
    else
        memset(&m->rx, 0, sizeof m->rx);
}

/* Starts with SOF when idle. In the third bit of the intermission the SOF of another node counts as
 * its own (M6). */
static void begin_transmission(cw_mac *m)
{
    m->started = true;
    m->tx_next = 0;
    if (m->fd)
        cw_mac_fd_renew_esi(m); /* so that its length is known from now on */
    if (m->phase == CW_MAC_IDLE) {
        cw_mac_begin_frame(m, CW_ROLE_TRANSMITTER);
        return;
    }
    m->role = CW_ROLE_TRANSMITTER; /* M6: the foreign SOF was this frame's */
    m->tx_next = 1;
}

/* Returns the level that a node drives in a frame: a transmitter its bits, a receiver its ACK bit
 * (M5). */
static bool drive_frame(const cw_mac *m)
{
    if (cw_mac_is_transmitter(m))
        return cw_bits_level(cw_mac_tx(m), m->tx_next);
    bool acknowledges = cw_mac_part_is(m, CW_PART_ACK) && !m->crc_error && !m->no_ack; /* M5, E3 */
    return acknowledges ? CW_DOMINANT : CW_RECESSIVE;
}

/* Returns the level that the phase asks for. Outside of frames only flags are dominant. */
static bool drive_phase(const cw_mac *m)
{
    if (m->phase == CW_MAC_FRAME)
        return drive_frame(m);
    return cw_mac_in_dominant_flag(m) ? CW_DOMINANT : CW_RECESSIVE;
}

bool cw_mac_level(const cw_mac *m)
{
    return cw_mac_is_hidden(m) ? CW_RECESSIVE : drive_phase(m);
}

/* Returns the level for the bus. The node's own view of it stays in `driven`, for modes that hide
 * it from the bus (M11, M15). */
static bool drive_on(cw_mac *m)
{
    m->may_join = false;
    if (m->fd)
        cw_mac_fd_update_esi(m);
    m->driven = drive_phase(m);
    return cw_mac_is_hidden(m) ? CW_RECESSIVE : m->driven;
}

bool cw_mac_drive(cw_mac *m)
{
    if (m->offered && cw_mac_can_start(m))
        begin_transmission(m);
    return drive_on(m);
}

bool cw_mac_drives_on(cw_mac *m, bool level)
{
    return !cw_mac_can_start(m) && drive_on(m) == level;
}

/* ---- Errors (E1..E9) and overload (O1, O2) --------------------------------------------------- */

/* Gives up the frame of an attempt that has failed (M13, L1). */
static void give_up_one_shot(cw_mac *m, cw_mac_report *r)
{
    if (m->modes & CW_MODES_SINGLE)
        drop_offer(m, CW_DROP_ONE_SHOT, r);
}

/* Returns true when the controller leaves a frame where others send flags (D19, L1). */
static bool sends_no_flags(const cw_mac *m)
{
    return m->modes & (CW_MODE_RESTRICTED | CW_MODE_TIME_TRIGGERED);
}

/* Reports an error in the present bit and starts the flag. The counters from before the error's own
 * increment decide the kind of the flag (R9). */
static void signal_error(cw_mac *m, cw_error_type type, bool tec_moves, unsigned rec_step,
                         cw_mac_report *r)
{
    bool passive = cw_confinement_passive(&m->confinement);
    r->what |= CW_REPORT_ERROR;
    r->fast = cw_mac_is_fast(m);
    r->error = (cw_error){.type = type, .role = (cw_role)m->role, .place = cw_mac_place(m),
                          .sent = type == CW_ERROR_BIT ? 1u + m->driven : 0};
    if (cw_mac_is_sending(m))
        give_up_one_shot(m, r);
    if (tec_moves)
        cw_confinement_tx_error(&m->confinement);
    if (rec_step)
        cw_confinement_rx_error(&m->confinement, rec_step);
    if (check_bus_off(m, r))
        return;
    if (sends_no_flags(m)) {
        r->error.flag = CW_FLAG_NONE;
        cw_mac_integrate(m);
        return;
    }
    r->error.flag = passive ? CW_FLAG_PASSIVE : CW_FLAG_ACTIVE;
    m->ack_deferred = false;
    cw_mac_enter(m, passive ? CW_MAC_ERROR_PASSIVE : CW_MAC_ERROR_ACTIVE);
}

/* Signals an error of a transmitter or receiver (R1, R3). */
static void detect(cw_mac *m, cw_error_type type, cw_mac_report *r)
{
    if (cw_mac_is_transmitter(m))
        signal_error(m, type, true, 0, r);
    else
        signal_error(m, type, false, 1, r);
}

/* Signals a bit error in the own active error flag or overload flag (R4, R5). */
static void detect_in_flag(cw_mac *m, cw_mac_report *r)
{
    if (cw_mac_is_transmitter(m))
        signal_error(m, CW_ERROR_BIT, true, 0, r);
    else
        signal_error(m, CW_ERROR_BIT, false, 8, r);
}

/* R3 i: the increment of a passive transmitter waits for a dominant bit in its flag. */
static void detect_missing_ack(cw_mac *m, cw_mac_report *r)
{
    bool deferred = cw_confinement_passive(&m->confinement);
    signal_error(m, CW_ERROR_ACK, !deferred, 0, r);
    m->ack_deferred = deferred && m->phase == CW_MAC_ERROR_PASSIVE;
}

bool cw_mac_force_error(cw_mac *m)
{
    cw_mac_report report = {.what = 0};
    if (cw_mac_is_on_bus(m) && m->phase != CW_MAC_INTEGRATING)
        detect(m, CW_ERROR_FORM, &report);
    return (report.what & CW_REPORT_DROPPED) && report.why == CW_DROP_ONE_SHOT;
}

/* Begins an overload flag (O2). A node that sends no flags waits for an idle bus instead (D19,
 * L1). */
static void signal_overload(cw_mac *m, cw_mac_report *r)
{
    if (sends_no_flags(m)) {
        cw_mac_integrate(m);
        return;
    }
    r->what |= CW_REPORT_OVERLOAD;
    cw_mac_enter(m, CW_MAC_OVERLOAD_FLAG);
}

/* Begins the intermission, or first an overload frame that the host wants (O1 a). */
static void expect_intermission(cw_mac *m, cw_mac_report *r)
{
    if (m->overloads_wanted > 0 && m->overloads_in_row < 2 && !sends_no_flags(m)) {
        m->overloads_wanted--;
        m->overloads_in_row++;
        signal_overload(m, r);
        return;
    }
    cw_mac_enter(m, CW_MAC_INTERMISSION);
}

/* ---- Sample: inside a frame ------------------------------------------------------------------ */

/* Takes an SRR for an RTR, until the real one comes. */
static void take_rtr(cw_mac *m)
{
    cw_frame *rx = cw_mac_rx(m);
    rx->flags &= (uint8_t)~CW_FRAME_REMOTE;
    if (cw_mac_last_level(m))
        rx->flags |= CW_FRAME_REMOTE;
}

/* Reports that the own frame has won the arbitration, at its last bit. IDE is the last one of a
 * base frame, since an extended frame may still lose by it. */
static void report_won(const cw_mac *m, cw_mac_report *r)
{
    const bool extended = m->part == CW_PART_RTR;
    if (m->tells_won && cw_mac_is_transmitter(m) && cw_bits_is_extended(cw_mac_tx(m)) == extended)
        r->what |= CW_REPORT_ARBITRATION_WON;
}

/* Judges the own ACK slot (M5). Returns true when the frame goes on, as do the next functions. */
static bool judge_own_ack(cw_mac *m, bool acknowledged, cw_mac_report *r)
{
    bool no_ack_needed = m->modes & (CW_MODE_PRESUME_ACK | CW_MODE_LOOPBACK); /* M14, M15 */
    if (acknowledged || no_ack_needed)
        return true;
    detect_missing_ack(m, r);
    return false;
}

/* The transmitter of an FD frame is acknowledged in the first bit or in the second (D7). */
static bool judge_ack(cw_mac *m, cw_mac_report *r)
{
    const bool dominant = !cw_mac_last_level(m);
    if (cw_mac_is_transmitter(m) && cw_mac_in_fd_frame(m)) {
        m->fd->acknowledged = dominant;
        return true;
    }
    if (cw_mac_is_transmitter(m))
        return judge_own_ack(m, dominant, r);
    if (m->crc_error || m->no_ack)
        return true;
    if (!dominant) {
        detect(m, CW_ERROR_BIT, r); /* E1 c */
        return false;
    }
    cw_confinement_rx_success(&m->confinement); /* R8: here, not at the end of EOF */
    return true;
}

/* Judges the second bit of the ACK slot of an FD frame, which matters to its transmitter alone
 * (D7). */
static bool judge_second_ack(cw_mac *m, cw_mac_report *r)
{
    if (!cw_mac_is_transmitter(m))
        return true;
    return judge_own_ack(m, m->fd->acknowledged || !cw_mac_last_level(m), r);
}

/* Leaves the frame without an error (D16), or with one where exceptions are switched off. */
static bool make_exception(cw_mac *m, cw_mac_report *r)
{
    if (m->protocol & CW_PROTOCOL_NO_EXCEPTION) {
        detect(m, CW_ERROR_FORM, r);
        return false;
    }
    r->what |= CW_REPORT_EXCEPTION;
    cw_mac_integrate(m);
    return false;
}

/* Takes FDF, a reserved bit to a classical controller (D17). */
static bool take_fdf(cw_mac *m, cw_mac_report *r)
{
    if (!cw_mac_last_level(m) || (m->protocol & CW_PROTOCOL_MASK) == CW_CLASSICAL)
        return true;
    if (!m->fd)
        return make_exception(m, r);
    cw_mac_fd_take_fdf(m);
    return true;
}

/* Takes res of an FD frame. Recessive, it is a protocol exception (D16). */
static bool take_res(cw_mac *m, cw_mac_report *r)
{
    return !cw_mac_last_level(m) || make_exception(m, r);
}

/* F4, except for controllers that know only nine values. */
static bool take_dlc(cw_mac *m, cw_mac_report *r)
{
    cw_mac_rx(m)->dlc = (uint8_t)m->shift;
    if (!m->no_long_dlc || m->shift <= CW_CLASSICAL_DATA_MAX || cw_mac_in_fd_frame(m))
        return true;
    detect(m, CW_ERROR_FORM, r);
    return false;
}

/* Signals a pending CRC error (E3). */
static bool signal_crc(cw_mac *m, cw_mac_report *r)
{
    if (m->crc_error)
        detect(m, CW_ERROR_CRC, r);
    return !m->crc_error;
}

/* M7: a receiver accepts the frame; so does a transmitter in loopback. */
static bool accept_frame(const cw_mac *m, cw_mac_report *r)
{
    if (!cw_mac_is_transmitter(m) || (m->modes & CW_MODE_LOOPBACK))
        r->what |= CW_REPORT_RX;
    return true;
}

/* Takes the end of EOF, where the frame becomes valid for its transmitter (M7, R7). */
static bool finish_frame(cw_mac *m, cw_mac_report *r)
{
    if (cw_mac_is_transmitter(m)) {
        m->offered = false;
        r->what |= CW_REPORT_TX;
        cw_confinement_tx_success(&m->confinement);
    }
    expect_intermission(m, r);
    return false;
}

/* Returns the level by which the part after the present one is chosen. Only a controller that knows
 * FD frames goes on to res, and one of CAN 2.0A knows base frames alone. */
static bool choosing_level(const cw_mac *m)
{
    const bool may_be_fdf = cw_parts[m->part].effect == CW_EFFECT_TAKE_FDF;
    const bool old = (m->protocol & CW_PROTOCOL_2_0A) && m->part == CW_PART_IDE;
    return cw_mac_last_level(m) && (m->fd || !may_be_fdf) && !old;
}

/* Carries out the effect of the end of the present part. Returns true when the frame goes on. */
static bool take_effect(cw_mac *m, cw_mac_report *r)
{
    const cw_part_info *part = &cw_parts[m->part];
    switch ((cw_effect)part->effect) {
    case CW_EFFECT_TAKE_ID:
        cw_mac_rx(m)->id = cw_mac_rx(m)->id << part->bits | m->shift;
        break;
    case CW_EFFECT_TAKE_RTR:
        take_rtr(m);
        if (m->part == CW_PART_RTR)
            report_won(m, r);
        break;
    case CW_EFFECT_TAKE_IDE:
        report_won(m, r);
        cw_mac_rx(m)->flags |= choosing_level(m) ? CW_FRAME_EXTENDED : 0;
        break;
    case CW_EFFECT_TAKE_FDF:
        return take_fdf(m, r);
    case CW_EFFECT_TAKE_RES:
        return take_res(m, r);
    case CW_EFFECT_TAKE_BRS:
        cw_mac_fd_take_brs(m);
        break;
    case CW_EFFECT_TAKE_ESI:
        cw_mac_fd_take_esi(m);
        break;
    case CW_EFFECT_TAKE_DLC:
        return take_dlc(m, r);
    case CW_EFFECT_JUDGE_STUFF_COUNT:
        m->crc_error = !cw_mac_is_transmitter(m) && m->shift != cw_stuff_count(m->fd->stuff_bits);
        break;
    case CW_EFFECT_JUDGE_CRC:
        m->crc_error = !cw_mac_is_transmitter(m) &&
                       (cw_mac_in_fd_frame(m) ? cw_mac_fd_crc_error(m) : m->shift != m->crc);
        break;
    case CW_EFFECT_END_DATA_PHASE:
        if (m->fd)
            m->fd->fast = false;
        break;
    case CW_EFFECT_JUDGE_ACK:
        return judge_ack(m, r);
    case CW_EFFECT_JUDGE_SECOND_ACK:
        return judge_second_ack(m, r);
    case CW_EFFECT_SIGNAL_CRC:
        return signal_crc(m, r);
    case CW_EFFECT_ACCEPT:
        return accept_frame(m, r);
    case CW_EFFECT_FINISH:
        return finish_frame(m, r);
    case CW_EFFECT_NONE:
    case CW_EFFECT_COUNT:
        break;
    }
    return true;
}

/* Returns the bits of the present part. The number of some follows from the frame. */
static unsigned bits_of_part(const cw_mac *m)
{
    const unsigned bits = cw_parts[m->part].bits;
    if (bits)
        return bits;
    const cw_form form = cw_frame_form(cw_mac_received(m));
    return cw_part_bits((cw_part)m->part, &form);
}

/* Not inlined, so that the bits inside a part, which are the most frequent, need not save registers
 * for it. */
__attribute__((noinline)) void cw_mac_end_part(cw_mac *m, cw_mac_report *r)
{
    const bool level = choosing_level(m);
    if (!take_effect(m, r))
        return;
    do {
        m->part = cw_parts[m->part].next[level];
        m->part_bits = (uint16_t)bits_of_part(m);
    } while (m->part_bits == 0); /* a frame without data */
    m->index = 0;
    m->shift = 0;
    if (cw_mac_has_fixed_stuffing(m))
        m->run = CW_STUFF_RUN; /* D3, D4: a fixed stuff bit comes first, whatever the run was */
}

/* Makes a receiver of the transmitter, from the next bit on, and reports the number of the lost bit
 * (M2). */
static void lose_arbitration(cw_mac *m, cw_mac_report *r)
{
    r->what |= CW_REPORT_ARBITRATION_LOST;
    /* the SJA1000 counts from the bit after SOF on, without stuff bits */
    r->lost_bit = (uint8_t)(cw_part_at[cw_bits_is_extended(cw_mac_tx(m))][m->part] + m->index - 1u);
    give_up_one_shot(m, r);
    m->role = CW_ROLE_RECEIVER;
}

/* R3 ii: returns true when the due recessive stuff bit stands before the RTR bit. A stuff bit that
 * follows the RTR is like any other, even when the RTR ends the arbitration field. SRR and IDE of
 * an extended frame are recessive: no recessive stuff bit follows them. */
static bool stuffs_before_rtr(const cw_mac *m)
{
    return cw_parts[m->before_part].field == CW_FIELD_ID;
}

/* Signals that a recessive stuff bit before the RTR was overwritten (R3 ii). */
static void detect_stuff_overwritten(cw_mac *m, cw_mac_report *r)
{
    signal_error(m, CW_ERROR_STUFF, false, 0, r);
}

/* Detects a wrong level of a stuff bit (E2), or of a fixed one, also the own (D14). */
static void detect_wrong_stuff_bit(cw_mac *m, cw_mac_report *r)
{
    detect(m, cw_mac_has_fixed_stuffing(m) ? CW_ERROR_FORM : CW_ERROR_STUFF, r);
}

/* Detects that a stuff bit of the transmitter has another level on the wire. */
static void detect_own_stuff_bit(cw_mac *m, cw_mac_report *r)
{
    if (cw_mac_has_fixed_stuffing(m))
        detect_wrong_stuff_bit(m, r);
    else if (m->driven && stuffs_before_rtr(m))
        detect_stuff_overwritten(m, r);
    else
        detect(m, CW_ERROR_BIT, r);
}

/* Takes a bit in the place of a stuff bit: the complement of the bit before it, or an error (E1,
 * E2, D14). */
static void sample_stuff_bit(cw_mac *m, bool level, cw_mac_report *r)
{
    if (cw_mac_is_transmitter(m) && level != m->driven) {
        detect_own_stuff_bit(m, r);
        return;
    }
    if (level == m->last) {
        detect_wrong_stuff_bit(m, r);
        return;
    }
    if (m->fd && !cw_mac_has_fixed_stuffing(m)) {
        cw_mac_fd_add_to_crc(m->fd, level);
        m->fd->stuff_bits++;
    }
    m->last = level;
    m->run = 1;
    m->tx_next++;
}

/* Handles a level that differs from the own one in a part that the transmitter monitors. Returns
 * true when the bit goes on, as a receiver's. */
static bool survives_mismatch(cw_mac *m, cw_mac_report *r)
{
    if (m->driven && cw_mac_part_is(m, CW_PART_ARBITRATION)) {
        lose_arbitration(m, r);
        return true;
    }
    detect(m, CW_ERROR_BIT, r);
    return false;
}

/* E4, and O1 c: for a receiver, a dominant last bit of EOF is not an error. */
static void dominant_in_fixed_form(cw_mac *m, cw_mac_report *r)
{
    if (m->part == CW_PART_LAST_EOF && !cw_mac_is_transmitter(m))
        signal_overload(m, r);
    else
        detect(m, CW_ERROR_FORM, r);
}

/* Counts equal bits, after which a stuff bit comes; in a part with fixed ones, bits. */
static inline void count_for_stuffing(cw_mac *m, unsigned flags, bool level)
{
    if ((flags & CW_PART_FIXED_STUFFED) && cw_mac_in_fd_frame(m))
        m->run = (m->index + 1u) % CW_FIXED_STUFF_DISTANCE == 0 ? CW_STUFF_RUN : 1;
    else
        m->run = (uint8_t)(level == m->last ? m->run + 1 : 1);
    m->last = level;
}

void cw_mac_take_bit(cw_mac *m, bool level)
{
    unsigned flags = cw_parts[m->part].flags;
    if (flags & CW_PART_IN_CRC)
        m->crc = cw_crc15_next(m->crc, level);
    if (m->fd && (flags & CW_PART_IN_FD_CRC))
        cw_mac_fd_add_to_crc(m->fd, level);
    if (flags & CW_PART_STUFFED)
        count_for_stuffing(m, flags, level);
    m->shift = m->shift << 1 | level;
    if (m->part == CW_PART_DATA && m->index % 8 == 7)
        cw_mac_rx(m)->data[m->index / 8] = (uint8_t)m->shift;
    m->before_part = m->part;
    m->before_index = m->index;
}

/* Samples a frame bit that is not a stuff bit. */
static void sample_frame_bit(cw_mac *m, bool level, cw_mac_report *r)
{
    unsigned flags = cw_parts[m->part].flags;
    if (cw_mac_is_transmitter(m) && (flags & CW_PART_MONITORED) && level != m->driven &&
        !survives_mismatch(m, r))
        return;
    if ((flags & CW_PART_RECESSIVE) && !level) {
        dominant_in_fixed_form(m, r);
        return;
    }
    cw_mac_take_bit(m, level);
    m->tx_next++;
    if (m->index + 1u < cw_mac_part_bits(m))
        m->index++;
    else
        cw_mac_end_part(m, r);
}

/* Takes a bit of a frame. An error found at a secondary sample point acts here, at the next sample
 * point (D13). */
static void sample_frame(cw_mac *m, bool level, cw_mac_report *r)
{
    if (m->fd && m->fd->late_error) {
        const cw_error_type error = (cw_error_type)(m->fd->late_error - 1);
        m->fd->late_error = 0;
        detect(m, error, r);
        r->error.sent = 0;
        return;
    }
    if (m->fd && (cw_mac_compares_late(m) || cw_mac_passes_delimiter(m)))
        level = m->driven;
    if (cw_mac_stuff_bit_due(m))
        sample_stuff_bit(m, level, r);
    else
        sample_frame_bit(m, level, r);
}

/* ---- Sample: between frames ------------------------------------------------------------------ */

/* Receives a foreign SOF (M1, M6). */
static void begin_reception(cw_mac *m, bool may_join, cw_mac_report *r)
{
    cw_mac_begin_frame(m, CW_ROLE_RECEIVER);
    m->may_join = may_join;
    sample_frame_bit(m, CW_DOMINANT, r);
}

void cw_mac_become_idle(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    m->overloads_in_row = 0; /* so that all idle controllers are equal */
    cw_mac_enter(m, m->sleeps ? CW_MAC_ASLEEP : CW_MAC_IDLE);
}

/* After a software reset the controller waits for as many groups as in R12. */
void cw_mac_end_integration(cw_mac *m)
{
    m->count = 0;
    if (m->waits_long && ++m->groups < CW_RECOVERY_GROUPS)
        return;
    m->waits_long = false;
    cw_mac_become_idle(m);
}

/* Counts recessive bits in a row. After eleven the node is on the bus (M10). */
static void sample_integrating(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)r;
    m->count = level ? (uint8_t)(m->count + 1) : 0;
    if (m->count == CW_INTEGRATION_BITS)
        cw_mac_end_integration(m);
}

/* Takes a dominant bit for SOF: the node joins if it has a frame to send (M1). */
static void sample_idle(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level)
        begin_reception(m, true, r);
}

/* Returns true when the controller owes suspend time (M8). */
static bool owes_suspend(const cw_mac *m)
{
    return cw_mac_is_transmitter(m) && cw_confinement_passive(&m->confinement);
}

void cw_mac_end_intermission(cw_mac *m)
{
    if (owes_suspend(m))
        cw_mac_enter(m, CW_MAC_SUSPEND);
    else
        cw_mac_become_idle(m);
}

/* A dominant bit is an overload condition in the first two bits (O1 b), and a SOF in the third
 * (M6). */
static void sample_intermission(cw_mac *m, bool level, cw_mac_report *r)
{
    bool third = m->count == CW_INTERMISSION_BITS - 1;
    if (!level && third)
        begin_reception(m, !owes_suspend(m), r);
    else if (!level)
        signal_overload(m, r); /* O1 b */
    else if (!third)
        m->count++;
    else
        cw_mac_end_intermission(m);
}

/* Counts the eight bits of M8. A dominant one is the SOF of another node (M1). */
static void sample_suspend(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level)
        begin_reception(m, false, r);
    else if (++m->count == CW_SUSPEND_BITS)
        cw_mac_become_idle(m);
}

/* ---- Sample: error and overload frames ------------------------------------------------------- */

void cw_mac_end_flag(cw_mac *m)
{
    cw_mac_enter(m, m->phase == CW_MAC_OVERLOAD_FLAG ? CW_MAC_OVERLOAD_WAIT : CW_MAC_ERROR_WAIT);
}

/* Samples a bit of an active error flag or overload flag. */
static void sample_dominant_flag(cw_mac *m, bool level, cw_mac_report *r)
{
    if (level)
        detect_in_flag(m, r);
    else if (++m->count == CW_FLAG_BITS)
        cw_mac_end_flag(m);
}

/* Reports that a counter moves without an error of its own. */
static void report_tolerated(const cw_mac *m, cw_mac_report *r)
{
    r->what |= CW_REPORT_TOLERATED;
    r->error = (cw_error){.role = (cw_role)m->role, .place = cw_mac_place(m)};
}

/* E7: the flag ends after six equal bits of either level. */
static void sample_passive_flag(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level && m->ack_deferred) {
        m->ack_deferred = false;
        report_tolerated(m, r);
        cw_confinement_tx_error(&m->confinement);
        if (check_bus_off(m, r))
            return;
    }
    m->count = m->count && level == m->last ? (uint8_t)(m->count + 1) : 1;
    m->last = level;
    if (m->count == CW_FLAG_BITS)
        cw_mac_end_flag(m);
}

/* R2, R6: counts dominant bits after the own flag; count is their number. */
static void count_dominant(cw_mac *m, cw_mac_report *r)
{
    bool first = m->count == 1 && m->phase == CW_MAC_ERROR_WAIT && !cw_mac_is_transmitter(m);
    bool eighth = m->count % 8 == 0;
    if (m->count == 16)
        m->count = 8; /* not 1 again: the first dominant bit moves a counter once, however many
                         follow */
    if (!first && !eighth)
        return;
    report_tolerated(m, r);
    if (cw_mac_is_transmitter(m))
        cw_confinement_tx_error(&m->confinement);
    else
        cw_confinement_rx_error(&m->confinement, 8);
    (void)check_bus_off(m, r);
}

/* E8: the first recessive bit is the first bit of the delimiter. */
static void sample_wait(cw_mac *m, bool level, cw_mac_report *r)
{
    bool error = m->phase == CW_MAC_ERROR_WAIT;
    if (level) {
        cw_mac_enter(m, error ? CW_MAC_ERROR_DELIMITER : CW_MAC_OVERLOAD_DELIMITER);
        m->count = 1;
        return;
    }
    m->count++;
    count_dominant(m, r);
}

/* Takes a bit of an error or overload delimiter (E8, O1 d). */
static void sample_delimiter(cw_mac *m, bool level, cw_mac_report *r)
{
    bool last = m->count == CW_DELIMITER_BITS - 1;
    if (!level && last)
        signal_overload(m, r); /* O1 d */
    else if (!level)
        detect(m, CW_ERROR_FORM, r); /* E8 */
    else if (last)
        expect_intermission(m, r);
    else
        m->count++;
}

/* ---- Sample: away from the bus --------------------------------------------------------------- */

/* Phases in which the node is off the bus, so that no level means anything. */
static void sample_nothing(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)m;
    (void)level;
    (void)r;
}

/* Drops an offer from before counters were set to bus-off; nothing else can be on offer. */
static void sample_bus_off(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    if (m->offered)
        drop_offer(m, CW_DROP_BUS_OFF, r);
}

/* Ends bus-off, after 128 groups of eleven recessive bits (R12). */
static void end_recovery(cw_mac *m)
{
    cw_confinement_reset(&m->confinement);
    cw_mac_become_idle(m); /* R12, ruling: no further integration */
}

/* R12: groups of eleven; a dominant bit spoils only the group. */
static void sample_recovering(cw_mac *m, bool level, cw_mac_report *r)
{
    sample_bus_off(m, level, r);
    m->count = level ? (uint8_t)(m->count + 1) : 0;
    if (m->count < CW_INTEGRATION_BITS)
        return;
    m->count = 0;
    if (++m->groups == CW_RECOVERY_GROUPS)
        end_recovery(m);
}

/* ---- Sample ---------------------------------------------------------------------------------- */

typedef void phase_handler(cw_mac *m, bool level, cw_mac_report *r);

static phase_handler *const sample_phase[CW_MAC_PHASE_COUNT] = {
    [CW_MAC_OFF] = sample_nothing,
    [CW_MAC_INTEGRATING] = sample_integrating,
    [CW_MAC_IDLE] = sample_idle,
    [CW_MAC_FRAME] = sample_frame,
    [CW_MAC_ERROR_ACTIVE] = sample_dominant_flag,
    [CW_MAC_ERROR_PASSIVE] = sample_passive_flag,
    [CW_MAC_ERROR_WAIT] = sample_wait,
    [CW_MAC_ERROR_DELIMITER] = sample_delimiter,
    [CW_MAC_OVERLOAD_FLAG] = sample_dominant_flag,
    [CW_MAC_OVERLOAD_WAIT] = sample_wait,
    [CW_MAC_OVERLOAD_DELIMITER] = sample_delimiter,
    [CW_MAC_INTERMISSION] = sample_intermission,
    [CW_MAC_SUSPEND] = sample_suspend,
    [CW_MAC_BUS_OFF] = sample_bus_off,
    [CW_MAC_RECOVERING] = sample_recovering,
    [CW_MAC_ASLEEP] = sample_nothing,
};

bool cw_mac_visible(const cw_mac *m, bool level)
{
    if (!cw_mac_is_hidden(m))
        return level;
    return m->driven && (level || (m->modes & CW_MODE_LOOPBACK));
}

void cw_mac_sample(cw_mac *m, bool level, cw_mac_report *report)
{
    const uint8_t phase = m->phase;
    report->what = m->started ? CW_REPORT_STARTED : 0;
    m->started = false;
    sample_phase[phase](m, cw_mac_visible(m, level), report);
    if (m->phase == CW_MAC_ASLEEP && phase != CW_MAC_ASLEEP)
        report->what |= CW_REPORT_SLEEP;
    if (m->confinement.state != m->reported_state) {
        m->reported_state = m->confinement.state;
        report->what |= CW_REPORT_STATE;
    }
}
