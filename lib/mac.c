/* SPDX-License-Identifier: MIT
 *
 * mac.c - one CAN controller, bit by bit (rules M, E, O and R of RULES.md).
 *
 * A bit has two phases. cw_mac_drive() says what the controller puts on the wire; cw_mac_sample()
 * takes what the wire carried and goes on to the next bit. Each phase of the controller has one
 * sample function; inside a frame, checks that hold for every bit come first, then a handler runs
 * when a step of the frame (see cw_steps) is complete. A transmitter parses its own frame as the
 * receivers do, so that it can become one of them in any bit (M2).
 */
#include "mac.h"

#include "bits.h"
#include "codec.h"
#include "confinement.h"

#include <assert.h>
#include <string.h>

/* ---- Set-up and what the host asks for ------------------------------------------------------- */

static void enter(cw_mac *m, cw_mac_phase phase)
{
    m->phase = (uint8_t)phase;
    m->count = 0;
}

static void integrate(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    enter(m, CW_MAC_INTEGRATING);
}

void cw_mac_init(cw_mac *m, unsigned modes, unsigned warning_limit)
{
    memset(m, 0, sizeof *m);
    m->confinement.warning_limit = (uint16_t)warning_limit;
    cw_mac_set_modes(m, modes);
    integrate(m);
}

static bool is_bus_off(const cw_mac *m)
{
    return m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_RECOVERING;
}

void cw_mac_set_modes(cw_mac *m, unsigned modes)
{
    const unsigned wire_modes = CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK;
    bool leaves = (m->modes ^ modes) & wire_modes;
    m->modes = (uint8_t)modes;
    m->confinement.frozen = modes & CW_MODE_LISTEN_ONLY;
    if (leaves && m->phase != CW_MAC_OFF && !is_bus_off(m))
        integrate(m);
}

bool cw_mac_is_on_bus(const cw_mac *m)
{
    return m->phase != CW_MAC_OFF && !is_bus_off(m);
}

void cw_mac_disconnect(cw_mac *m)
{
    if (is_bus_off(m))
        return;
    m->role = CW_ROLE_NONE;
    enter(m, CW_MAC_OFF);
}

void cw_mac_reconnect(cw_mac *m)
{
    if (m->phase == CW_MAC_OFF)
        integrate(m);
}

static bool is_transmitter(const cw_mac *m)
{
    return m->role == CW_ROLE_TRANSMITTER;
}

bool cw_mac_is_sending(const cw_mac *m)
{
    return m->phase == CW_MAC_FRAME && is_transmitter(m);
}

bool cw_mac_can_start(const cw_mac *m)
{
    bool free = m->phase == CW_MAC_IDLE || (m->phase == CW_MAC_FRAME && m->may_join);
    return free && !(m->modes & CW_MODE_LISTEN_ONLY);
}

cw_status cw_mac_offer(cw_mac *m, const cw_frame *frame)
{
    if (is_bus_off(m) || cw_mac_is_sending(m) || (m->modes & CW_MODE_LISTEN_ONLY))
        return CW_REFUSED;
    if (cw_bits_encode(&m->tx, frame) != CW_OK)
        return CW_INVALID;
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
    if (frames < 1 || frames > 2)
        return CW_INVALID;
    m->overloads_wanted = (uint8_t)frames;
    return CW_OK;
}

cw_status cw_mac_request_restart(cw_mac *m)
{
    if (m->phase != CW_MAC_BUS_OFF)
        return CW_REFUSED;
    m->groups = 0;
    enter(m, CW_MAC_RECOVERING);
    return CW_OK;
}

/* R10: at once, whatever was being sent. */
static void go_bus_off(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    m->offered = false;
    enter(m, CW_MAC_BUS_OFF);
}

/* Carries out R10 after a counter has moved; returns whether it did. */
static bool check_bus_off(cw_mac *m)
{
    if (m->confinement.state != CW_STATE_BUS_OFF)
        return false;
    go_bus_off(m);
    return true;
}

cw_status cw_mac_set_counters(cw_mac *m, unsigned tec, unsigned rec)
{
    if (tec > CW_TEC_MAX || rec > CW_REC_MAX)
        return CW_INVALID;
    bool was_off = m->confinement.state == CW_STATE_BUS_OFF;
    cw_confinement_set(&m->confinement, tec, rec);
    bool is_off = m->confinement.state == CW_STATE_BUS_OFF;
    if (is_off && !was_off) /* else it goes on waiting or counting */
        go_bus_off(m);
    if (was_off && !is_off)
        integrate(m);
    return CW_OK;
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
    return &m->rx;
}

/* Also behind the last CRC bit (F7); after that run stays as it is, below the limit. */
static bool stuff_bit_due(const cw_mac *m)
{
    return m->run == CW_STUFF_RUN;
}

/* A receiver cannot tell SRR from RTR before the IDE; it takes the bit for an RTR. */
static cw_place frame_place(const cw_mac *m)
{
    bool extended = is_transmitter(m) ? m->tx.extended : (m->rx.flags & CW_FRAME_EXTENDED) != 0;
    if (!stuff_bit_due(m))
        return cw_step_place((cw_step)m->step, m->index, extended);
    cw_place place = cw_step_place((cw_step)m->before_step, m->before_index, extended);
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

/* ---- Drive ----------------------------------------------------------------------------------- */

static void begin_frame(cw_mac *m, cw_role role)
{
    enter(m, CW_MAC_FRAME);
    m->role = (uint8_t)role;
    m->step = CW_STEP_SOF;
    m->index = 0;
    m->run = 0;
    m->crc = 0;
    m->overloads_in_row = 0;
    memset(&m->rx, 0, sizeof m->rx);
}

static void begin_transmission(cw_mac *m)
{
    m->started = true;
    m->tx_next = 0;
    if (m->phase == CW_MAC_IDLE) {
        begin_frame(m, CW_ROLE_TRANSMITTER);
        return;
    }
    m->role = CW_ROLE_TRANSMITTER; /* M6: the foreign SOF was this frame's */
    m->tx_next = 1;
}

static bool drive_frame(const cw_mac *m)
{
    if (is_transmitter(m))
        return cw_bits_level(&m->tx, m->tx_next);
    bool acknowledges = m->step == CW_STEP_ACK_SLOT && !m->crc_error && !m->no_ack; /* M5, E3 */
    return acknowledges ? CW_DOMINANT : CW_RECESSIVE;
}

static bool in_dominant_flag(const cw_mac *m)
{
    return m->phase == CW_MAC_ERROR_ACTIVE || m->phase == CW_MAC_OVERLOAD_FLAG;
}

/* M11, M15. */
static bool is_hidden(const cw_mac *m)
{
    return m->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_LOOPBACK);
}

bool cw_mac_drive(cw_mac *m)
{
    if (m->offered && cw_mac_can_start(m))
        begin_transmission(m);
    m->may_join = false;
    m->driven = CW_RECESSIVE;
    if (m->phase == CW_MAC_FRAME)
        m->driven = drive_frame(m);
    else if (in_dominant_flag(m))
        m->driven = CW_DOMINANT;
    return is_hidden(m) ? CW_RECESSIVE : m->driven;
}

bool cw_mac_holds_wire(const cw_mac *m)
{
    return in_dominant_flag(m) && !is_hidden(m);
}

/* ---- Errors (E1..E9) and overload (O1, O2) --------------------------------------------------- */

static void give_up_one_shot(cw_mac *m, cw_mac_report *r)
{
    if (!(m->modes & CW_MODE_ONE_SHOT))
        return;
    m->offered = false;
    r->what |= CW_REPORT_DROPPED;
}

/* Reports an error in the present bit and starts the flag. The kind of the flag is that from
 * before the error's own increment (R9). */
static void signal_error(cw_mac *m, cw_error_type type, bool tec_moves, unsigned rec_step,
                         cw_mac_report *r)
{
    bool passive = cw_confinement_passive(&m->confinement);
    r->what |= CW_REPORT_ERROR;
    r->error = (cw_error){.type = type, .role = (cw_role)m->role, .place = cw_mac_place(m)};
    if (cw_mac_is_sending(m))
        give_up_one_shot(m, r);
    if (tec_moves)
        cw_confinement_tx_error(&m->confinement);
    if (rec_step)
        cw_confinement_rx_error(&m->confinement, rec_step);
    if (check_bus_off(m))
        return;
    r->error.flag = passive ? CW_FLAG_PASSIVE : CW_FLAG_ACTIVE;
    m->ack_deferred = false;
    enter(m, passive ? CW_MAC_ERROR_PASSIVE : CW_MAC_ERROR_ACTIVE);
}

/* R1, R3. */
static void detect(cw_mac *m, cw_error_type type, cw_mac_report *r)
{
    if (is_transmitter(m))
        signal_error(m, type, true, 0, r);
    else
        signal_error(m, type, false, 1, r);
}

/* R4, R5: a bit error in the own active error flag or overload flag. */
static void detect_in_flag(cw_mac *m, cw_mac_report *r)
{
    if (is_transmitter(m))
        signal_error(m, CW_ERROR_BIT, true, 0, r);
    else
        signal_error(m, CW_ERROR_BIT, false, 8, r);
}

/* R3 i: the increment of a passive transmitter waits for a dominant bit in its flag. */
static void detect_missing_ack(cw_mac *m, cw_mac_report *r)
{
    bool deferred = cw_confinement_passive(&m->confinement);
    signal_error(m, CW_ERROR_ACK, !deferred, 0, r);
    m->ack_deferred = deferred;
}

bool cw_mac_force_error(cw_mac *m)
{
    cw_mac_report report = {.what = 0};
    if (m->phase != CW_MAC_OFF && m->phase != CW_MAC_INTEGRATING && !is_bus_off(m))
        detect(m, CW_ERROR_FORM, &report);
    return report.what & CW_REPORT_DROPPED;
}

static void signal_overload(cw_mac *m, cw_mac_report *r)
{
    r->what |= CW_REPORT_OVERLOAD;
    enter(m, CW_MAC_OVERLOAD_FLAG);
}

/* Where intermission would begin: first the overload frames that the host wants (O1 a). */
static void expect_intermission(cw_mac *m, cw_mac_report *r)
{
    if (m->overloads_wanted > 0 && m->overloads_in_row < 2) {
        m->overloads_wanted--;
        m->overloads_in_row++;
        signal_overload(m, r);
        return;
    }
    enter(m, CW_MAC_INTERMISSION);
}

/* ---- Sample: inside a frame ------------------------------------------------------------------ */

typedef void step_handler(cw_mac *m, bool level, cw_mac_report *r);

static void go_to(cw_mac *m, cw_step step)
{
    m->step = (uint8_t)step;
    m->index = 0;
    m->shift = 0;
}

static void end_sof(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    go_to(m, CW_STEP_BASE_ID);
}

static void end_base_id(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    m->rx.id = m->shift;
    go_to(m, CW_STEP_SRR_RTR);
}

static void end_rtr(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)r;
    bool first = m->step == CW_STEP_SRR_RTR;
    m->rx.flags &= (uint8_t)~CW_FRAME_REMOTE;
    if (level)
        m->rx.flags |= CW_FRAME_REMOTE; /* an SRR is corrected by the real RTR later */
    go_to(m, first ? CW_STEP_IDE : CW_STEP_R1);
}

static void end_ide(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)r;
    if (level)
        m->rx.flags |= CW_FRAME_EXTENDED;
    go_to(m, level ? CW_STEP_EXTENDED_ID : CW_STEP_R0);
}

static void end_extended_id(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    m->rx.id = m->rx.id << 18 | m->shift;
    go_to(m, CW_STEP_RTR);
}

/* F5: either level is accepted. */
static void end_reserved(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    go_to(m, m->step == CW_STEP_R1 ? CW_STEP_R0 : CW_STEP_DLC);
}

static void end_dlc(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    m->rx.dlc = (uint8_t)m->shift;
    go_to(m, cw_frame_length(&m->rx) ? CW_STEP_DATA : CW_STEP_CRC);
}

static void end_data(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    go_to(m, CW_STEP_CRC);
}

static void end_crc(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    m->crc_error = !is_transmitter(m) && m->shift != m->crc;
    go_to(m, CW_STEP_CRC_DELIMITER);
}

static void end_crc_delimiter(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    (void)r;
    go_to(m, CW_STEP_ACK_SLOT);
}

static void end_ack_slot(cw_mac *m, bool level, cw_mac_report *r)
{
    bool no_ack_needed = m->modes & (CW_MODE_PRESUME_ACK | CW_MODE_LOOPBACK); /* M14, M15 */
    if (is_transmitter(m)) {
        if (level && !no_ack_needed) {
            detect_missing_ack(m, r);
            return;
        }
    } else if (!m->crc_error && !m->no_ack) {
        if (level) {
            detect(m, CW_ERROR_BIT, r); /* E1 c */
            return;
        }
        cw_confinement_rx_success(&m->confinement); /* R8: here, not at the end of EOF */
    }
    go_to(m, CW_STEP_ACK_DELIMITER);
}

static void end_ack_delimiter(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    if (m->crc_error)
        detect(m, CW_ERROR_CRC, r); /* E3 */
    else
        go_to(m, CW_STEP_EOF);
}

static void end_eof(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)level;
    if (is_transmitter(m)) {
        m->offered = false;
        r->what |= CW_REPORT_TX;
        cw_confinement_tx_success(&m->confinement);
    }
    expect_intermission(m, r);
}

static step_handler *const end_step[CW_STEP_COUNT] = {
    [CW_STEP_SOF] = end_sof,
    [CW_STEP_BASE_ID] = end_base_id,
    [CW_STEP_SRR_RTR] = end_rtr,
    [CW_STEP_IDE] = end_ide,
    [CW_STEP_EXTENDED_ID] = end_extended_id,
    [CW_STEP_RTR] = end_rtr,
    [CW_STEP_R1] = end_reserved,
    [CW_STEP_R0] = end_reserved,
    [CW_STEP_DLC] = end_dlc,
    [CW_STEP_DATA] = end_data,
    [CW_STEP_CRC] = end_crc,
    [CW_STEP_CRC_DELIMITER] = end_crc_delimiter,
    [CW_STEP_ACK_SLOT] = end_ack_slot,
    [CW_STEP_ACK_DELIMITER] = end_ack_delimiter,
    [CW_STEP_EOF] = end_eof,
};

/* Whether a step belongs to the arbitration field of the own frame (M2): the IDE only does in an
 * extended frame. */
static bool arbitrates(const cw_mac *m, unsigned step)
{
    return (cw_steps[step].flags & CW_STEP_ARBITRATION) ||
           (step == CW_STEP_IDE && m->tx.extended);
}

/* As the SJA1000 counts: the 11 bits, RTR/SRR, IDE, the 18 bits, RTR. */
static uint8_t arbitration_bit(const cw_mac *m)
{
    if (m->step == CW_STEP_SRR_RTR)
        return 11;
    if (m->step == CW_STEP_IDE)
        return 12;
    if (m->step == CW_STEP_EXTENDED_ID)
        return (uint8_t)(13 + m->index);
    return m->step == CW_STEP_RTR ? 31 : m->index;
}

static void lose_arbitration(cw_mac *m, cw_mac_report *r)
{
    r->what |= CW_REPORT_ARBITRATION_LOST;
    r->lost_bit = arbitration_bit(m);
    give_up_one_shot(m, r);
    m->role = CW_ROLE_RECEIVER;
}

/* R3 ii: a recessive stuff bit of the arbitration field that was overwritten. */
static void detect_stuff_overwritten(cw_mac *m, cw_mac_report *r)
{
    signal_error(m, CW_ERROR_STUFF, false, 0, r);
}

static void sample_stuff_bit(cw_mac *m, bool level, cw_mac_report *r)
{
    if (is_transmitter(m) && level != m->driven) {
        if (m->driven && arbitrates(m, m->before_step))
            detect_stuff_overwritten(m, r);
        else
            detect(m, CW_ERROR_BIT, r);
        return;
    }
    if (level == m->last) {
        detect(m, CW_ERROR_STUFF, r); /* E2 */
        return;
    }
    m->last = level;
    m->run = 1;
    m->tx_next++;
}

/* The level differs from the own one in a part that the transmitter monitors. Returns whether the
 * bit goes on, as a receiver's. */
static bool survives_mismatch(cw_mac *m, cw_mac_report *r)
{
    if (m->driven && arbitrates(m, m->step)) {
        lose_arbitration(m, r);
        return true;
    }
    detect(m, CW_ERROR_BIT, r);
    return false;
}

/* E4, and O1 c: to a receiver the last bit of EOF is no error any more. */
static void dominant_in_fixed_form(cw_mac *m, cw_mac_report *r)
{
    bool last = m->step == CW_STEP_EOF && m->index == CW_EOF_BITS - 1;
    if (last && !is_transmitter(m))
        signal_overload(m, r);
    else
        detect(m, CW_ERROR_FORM, r);
}

static void take_bit(cw_mac *m, bool level)
{
    unsigned flags = cw_steps[m->step].flags;
    if (flags & CW_STEP_IN_CRC)
        m->crc = cw_crc_next(m->crc, level);
    if (flags & CW_STEP_STUFFED) {
        m->run = (uint8_t)(level == m->last && m->run ? m->run + 1 : 1);
        m->last = level;
    }
    m->shift = m->shift << 1 | level;
    if (m->step == CW_STEP_DATA && m->index % 8 == 7)
        m->rx.data[m->index / 8] = (uint8_t)m->shift;
    m->before_step = m->step;
    m->before_index = m->index;
}

static unsigned step_length(const cw_mac *m)
{
    if (m->step == CW_STEP_DATA)
        return 8 * cw_frame_length(&m->rx);
    return cw_steps[m->step].length;
}

/* M7: a frame is a receiver's, or that of a transmitter in loopback, after the last but one bit. */
static void report_reception(const cw_mac *m, cw_mac_report *r)
{
    bool last_but_one = m->step == CW_STEP_EOF && m->index == CW_EOF_BITS - 2;
    if (last_but_one && (!is_transmitter(m) || (m->modes & CW_MODE_LOOPBACK)))
        r->what |= CW_REPORT_RX;
}

/* A frame bit that is no stuff bit. */
static void sample_frame_bit(cw_mac *m, bool level, cw_mac_report *r)
{
    unsigned flags = cw_steps[m->step].flags;
    if (is_transmitter(m) && (flags & CW_STEP_STUFFED) && level != m->driven &&
        !survives_mismatch(m, r))
        return;
    if ((flags & CW_STEP_FIXED_FORM) && !level) {
        dominant_in_fixed_form(m, r);
        return;
    }
    take_bit(m, level);
    report_reception(m, r);
    m->tx_next++;
    if (m->index + 1u < step_length(m))
        m->index++;
    else
        end_step[m->step](m, level, r);
}

static void sample_frame(cw_mac *m, bool level, cw_mac_report *r)
{
    if (stuff_bit_due(m))
        sample_stuff_bit(m, level, r);
    else
        sample_frame_bit(m, level, r);
}

/* ---- Sample: between frames ------------------------------------------------------------------ */

/* A foreign SOF (M1, M6). */
static void begin_reception(cw_mac *m, bool may_join, cw_mac_report *r)
{
    begin_frame(m, CW_ROLE_RECEIVER);
    m->may_join = may_join;
    sample_frame_bit(m, CW_DOMINANT, r);
}

static void become_idle(cw_mac *m)
{
    m->role = CW_ROLE_NONE;
    m->overloads_in_row = 0; /* so idle is idle, whatever came before */
    enter(m, CW_MAC_IDLE);
}

static void sample_integrating(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)r;
    m->count = level ? (uint8_t)(m->count + 1) : 0;
    if (m->count == CW_INTEGRATION_BITS)
        become_idle(m);
}

static void sample_idle(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level)
        begin_reception(m, true, r);
}

/* M8. */
static bool owes_suspend(const cw_mac *m)
{
    return is_transmitter(m) && cw_confinement_passive(&m->confinement);
}

static void end_intermission(cw_mac *m)
{
    if (owes_suspend(m))
        enter(m, CW_MAC_SUSPEND);
    else
        become_idle(m);
}

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
        end_intermission(m);
}

static void sample_suspend(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level)
        begin_reception(m, false, r);
    else if (++m->count == CW_SUSPEND_BITS)
        become_idle(m);
}

/* ---- Sample: error and overload frames ------------------------------------------------------- */

static void end_flag(cw_mac *m)
{
    enter(m, m->phase == CW_MAC_OVERLOAD_FLAG ? CW_MAC_OVERLOAD_WAIT : CW_MAC_ERROR_WAIT);
}

/* Active error flag and overload flag. */
static void sample_dominant_flag(cw_mac *m, bool level, cw_mac_report *r)
{
    if (level)
        detect_in_flag(m, r);
    else if (++m->count == CW_FLAG_BITS)
        end_flag(m);
}

/* A counter moves without an error of its own. */
static void report_tolerated(const cw_mac *m, cw_mac_report *r)
{
    r->what |= CW_REPORT_TOLERATED;
    r->error = (cw_error){.role = (cw_role)m->role, .place = cw_mac_place(m)};
}

/* E7: six equal bits, of either level. */
static void sample_passive_flag(cw_mac *m, bool level, cw_mac_report *r)
{
    if (!level && m->ack_deferred) {
        m->ack_deferred = false;
        report_tolerated(m, r);
        cw_confinement_tx_error(&m->confinement);
        if (check_bus_off(m))
            return;
    }
    m->count = m->count && level == m->last ? (uint8_t)(m->count + 1) : 1;
    m->last = level;
    if (m->count == CW_FLAG_BITS)
        end_flag(m);
}

/* R2, R6: dominant bits after the own flag; count is how many. */
static void count_dominant(cw_mac *m, cw_mac_report *r)
{
    bool first = m->count == 1 && m->phase == CW_MAC_ERROR_WAIT && !is_transmitter(m);
    bool eighth = m->count % 8 == 0;
    if (m->count == 16)
        m->count = 8; /* the first dominant bit is counted once, however long it goes on */
    if (!first && !eighth)
        return;
    report_tolerated(m, r);
    if (is_transmitter(m))
        cw_confinement_tx_error(&m->confinement);
    else
        cw_confinement_rx_error(&m->confinement, 8);
    (void)check_bus_off(m);
}

/* E8: the first recessive bit is the first bit of the delimiter. */
static void sample_wait(cw_mac *m, bool level, cw_mac_report *r)
{
    bool error = m->phase == CW_MAC_ERROR_WAIT;
    if (level) {
        enter(m, error ? CW_MAC_ERROR_DELIMITER : CW_MAC_OVERLOAD_DELIMITER);
        m->count = 1;
        return;
    }
    m->count++;
    count_dominant(m, r);
}

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

static void sample_nothing(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)m;
    (void)level;
    (void)r;
}

static void end_recovery(cw_mac *m)
{
    cw_confinement_reset(&m->confinement);
    become_idle(m); /* R12, ruling: no further integration */
}

/* R12: groups of eleven; a dominant bit spoils only the group. */
static void sample_recovering(cw_mac *m, bool level, cw_mac_report *r)
{
    (void)r;
    m->count = level ? (uint8_t)(m->count + 1) : 0;
    if (m->count < CW_INTEGRATION_BITS)
        return;
    m->count = 0;
    if (++m->groups == CW_RECOVERY_GROUPS)
        end_recovery(m);
}

/* ---- Sample ---------------------------------------------------------------------------------- */

static step_handler *const sample_phase[CW_MAC_PHASE_COUNT] = {
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
    [CW_MAC_BUS_OFF] = sample_nothing,
    [CW_MAC_RECOVERING] = sample_recovering,
};

bool cw_mac_visible(const cw_mac *m, bool level)
{
    if (!is_hidden(m))
        return level;
    return m->driven && (level || (m->modes & CW_MODE_LOOPBACK));
}

void cw_mac_sample(cw_mac *m, bool level, cw_mac_report *report)
{
    report->what = m->started ? CW_REPORT_STARTED : 0;
    m->started = false;
    sample_phase[m->phase](m, cw_mac_visible(m, level), report);
    if (m->confinement.state != m->told_state) {
        m->told_state = m->confinement.state;
        report->what |= CW_REPORT_STATE;
    }
}

/* ---- For the bus: several bits of one level -------------------------------------------------- */

/* What the controller sees when the wire has a level, with what it drives now. */
static bool sees(const cw_mac *m, bool level)
{
    cw_mac now = {.modes = m->modes, .driven = !in_dominant_flag(m)};
    return cw_mac_visible(&now, level);
}

/* Equal bits that a passive flag has seen, if bits of this level go on with them (E7). */
static unsigned flag_bits(const cw_mac *m, bool level)
{
    return m->count && m->last == level ? m->count : 0;
}

/* E8: a controller that waits for the delimiter takes its first bit next. */
static unsigned delimiter_bits(const cw_mac *m)
{
    bool waits = m->phase == CW_MAC_ERROR_WAIT || m->phase == CW_MAC_OVERLOAD_WAIT;
    return waits ? 0 : m->count;
}

/* Of a receiver: up to the last bit but one of the present step, or a stuff bit. */
static uint64_t steady_frame_bits(const cw_mac *m, bool level)
{
    bool stuffed = cw_steps[m->step].flags & CW_STEP_STUFFED;
    if (is_transmitter(m) || m->may_join || !stuffed || stuff_bit_due(m))
        return 0;
    unsigned left = step_length(m) - m->index - 1u;
    unsigned run = CW_STUFF_RUN - (level == m->last ? m->run : 0u);
    return left < run ? left : run;
}

/* R2, R6: up to a dominant bit that moves a counter. */
static uint64_t tolerated_bits(const cw_mac *m)
{
    bool first = m->count == 0 && m->phase == CW_MAC_ERROR_WAIT && !is_transmitter(m);
    return first ? 0 : 7u - m->count % 8u;
}

static uint64_t steady_dominant_bits(const cw_mac *m)
{
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_OFF:
    case CW_MAC_BUS_OFF:
    case CW_MAC_INTEGRATING:
    case CW_MAC_RECOVERING:
        return CW_QUIET_FOREVER;
    case CW_MAC_FRAME:
        return steady_frame_bits(m, CW_DOMINANT);
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
        return CW_FLAG_BITS - (uint64_t)m->count;
    case CW_MAC_ERROR_PASSIVE:
        return m->ack_deferred ? 0 : CW_FLAG_BITS - (uint64_t)flag_bits(m, CW_DOMINANT);
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        return tolerated_bits(m);
    case CW_MAC_IDLE:
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
    case CW_MAC_INTERMISSION:
    case CW_MAC_SUSPEND:
    case CW_MAC_PHASE_COUNT:
        return 0;
    }
    return 0;
}

/* The last bit of the delimiter may lead to an overload frame (O1 a), or to the intermission. */
static uint64_t steady_delimiter_bits(const cw_mac *m)
{
    unsigned left = CW_DELIMITER_BITS - delimiter_bits(m);
    return m->overloads_wanted > 0 ? left - 1 : left + CW_INTERMISSION_BITS;
}

static uint64_t steady_recessive_bits(const cw_mac *m)
{
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_OFF:
    case CW_MAC_BUS_OFF:
        return CW_QUIET_FOREVER;
    case CW_MAC_IDLE:
        return m->offered ? 0 : CW_QUIET_FOREVER;
    case CW_MAC_INTEGRATING:
        return CW_INTEGRATION_BITS - m->count;
    case CW_MAC_SUSPEND:
        return CW_SUSPEND_BITS - (uint64_t)m->count;
    case CW_MAC_RECOVERING: /* all but the last bit of the last group */
        return CW_INTEGRATION_BITS * (CW_RECOVERY_GROUPS - (uint64_t)m->groups) - m->count - 1;
    case CW_MAC_FRAME:
        return steady_frame_bits(m, CW_RECESSIVE);
    case CW_MAC_ERROR_PASSIVE:
        return CW_FLAG_BITS - (uint64_t)flag_bits(m, CW_RECESSIVE);
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_WAIT:
    case CW_MAC_OVERLOAD_DELIMITER:
        return steady_delimiter_bits(m);
    case CW_MAC_INTERMISSION:
        return CW_INTERMISSION_BITS - (uint64_t)m->count;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
    case CW_MAC_PHASE_COUNT:
        return 0;
    }
    return 0;
}

uint64_t cw_mac_steady_bits(const cw_mac *m, bool level)
{
    if (m->told_state != m->confinement.state)
        return 0;
    return sees(m, level) ? steady_recessive_bits(m) : steady_dominant_bits(m);
}

static void skip_frame_bits(cw_mac *m, unsigned bits, bool level)
{
    for (; bits > 0; bits--, m->index++)
        take_bit(m, level);
}

static void skip_flag(cw_mac *m, unsigned count, bool level)
{
    m->count = (uint8_t)count;
    m->last = level;
    if (m->count == CW_FLAG_BITS)
        end_flag(m);
}

/* Counts up to the end of a phase that is followed by idle. */
static void skip_to_idle(cw_mac *m, uint64_t bits, unsigned end)
{
    m->count = (uint8_t)(m->count + bits);
    if (m->count < end)
        return;
    if (m->phase == CW_MAC_INTERMISSION)
        end_intermission(m);
    else
        become_idle(m);
}

static void skip_delimiter(cw_mac *m, unsigned bits)
{
    bool error = m->phase == CW_MAC_ERROR_WAIT || m->phase == CW_MAC_ERROR_DELIMITER;
    unsigned count = delimiter_bits(m) + bits;
    if (count < CW_DELIMITER_BITS) {
        enter(m, error ? CW_MAC_ERROR_DELIMITER : CW_MAC_OVERLOAD_DELIMITER);
        m->count = (uint8_t)count;
        return;
    }
    enter(m, CW_MAC_INTERMISSION);
    skip_to_idle(m, count - CW_DELIMITER_BITS, CW_INTERMISSION_BITS);
}

static void skip_wait(cw_mac *m, unsigned bits, bool level)
{
    if (level)
        skip_delimiter(m, bits);
    else
        m->count = (uint8_t)(m->count + bits);
}

static void skip_recovery(cw_mac *m, uint64_t bits, bool level)
{
    uint64_t seen = level ? m->count + bits : 0;
    m->groups = (uint8_t)(m->groups + seen / CW_INTEGRATION_BITS);
    m->count = (uint8_t)(seen % CW_INTEGRATION_BITS);
}

static void skip_integration(cw_mac *m, uint64_t bits, bool level)
{
    if (level)
        skip_to_idle(m, bits, CW_INTEGRATION_BITS);
    else
        m->count = 0;
}

void cw_mac_skip(cw_mac *m, uint64_t bits, bool level)
{
    assert(bits > 0);
    level = sees(m, level);
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_RECOVERING:
        skip_recovery(m, bits, level);
        break;
    case CW_MAC_INTEGRATING:
        skip_integration(m, bits, level);
        break;
    case CW_MAC_SUSPEND:
        skip_to_idle(m, bits, CW_SUSPEND_BITS);
        break;
    case CW_MAC_INTERMISSION:
        skip_to_idle(m, bits, CW_INTERMISSION_BITS);
        break;
    case CW_MAC_FRAME:
        skip_frame_bits(m, (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_PASSIVE:
        skip_flag(m, flag_bits(m, level) + (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
        skip_flag(m, m->count + (unsigned)bits, m->last);
        break;
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        skip_wait(m, (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
        skip_delimiter(m, (unsigned)bits);
        break;
    case CW_MAC_OFF:
    case CW_MAC_BUS_OFF:
    case CW_MAC_IDLE:
    case CW_MAC_PHASE_COUNT:
        break; /* nothing counts */
    }
}

/* ---- For the bus ----------------------------------------------------------------------------- */

/* Of a transmitter: the last but one EOF bit, where the receivers take the frame, then the last. */
static uint64_t bits_to_frame_end(const cw_mac *m)
{
    unsigned left = (unsigned)m->tx.length - m->tx_next;
    return left > 1 ? left - 1u : left;
}

/* Of a receiver behind the CRC. In the last bit of EOF there is nothing more to come. */
static uint64_t bits_to_reception(const cw_mac *m)
{
    if (m->step == CW_STEP_EOF)
        return m->index < CW_EOF_BITS - 1 ? CW_EOF_BITS - 1u - m->index : CW_QUIET_FOREVER;
    return CW_STEP_EOF - m->step + CW_EOF_BITS - 1u;
}

uint64_t cw_mac_horizon(const cw_mac *m, bool waiting)
{
    const uint64_t next_frame = waiting ? CW_FRAME_BITS_MIN - 1 : CW_QUIET_FOREVER;
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_FRAME:
        if (is_transmitter(m))
            return bits_to_frame_end(m);
        if (m->step >= CW_STEP_CRC_DELIMITER)
            return bits_to_reception(m);
        if (m->may_join && waiting)
            return CW_FRAME_BITS_MIN - 2;
        return CW_QUIET_FOREVER; /* the transmitter knows */
    case CW_MAC_RECOVERING:
        return steady_recessive_bits(m) + 1;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_ERROR_PASSIVE:
    case CW_MAC_OVERLOAD_FLAG:
        return CW_FLAG_BITS - (uint64_t)m->count + CW_DELIMITER_BITS;
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        return CW_DELIMITER_BITS;
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
        return CW_DELIMITER_BITS - (uint64_t)m->count;
    case CW_MAC_INTERMISSION:
    case CW_MAC_SUSPEND:
    case CW_MAC_INTEGRATING:
    case CW_MAC_IDLE:
        return next_frame;
    case CW_MAC_OFF:
    case CW_MAC_BUS_OFF:
    case CW_MAC_PHASE_COUNT:
        return CW_QUIET_FOREVER;
    }
    return CW_QUIET_FOREVER;
}

/* What has been received so far; not memcmp() of all, which would compare padding, too. */
static bool same_received(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, sizeof a->data) == 0;
}

/* Where in a frame they are, and what they have read of it. */
static bool same_place(const cw_mac *a, const cw_mac *b)
{
    return a->step == b->step && a->index == b->index && a->run == b->run && a->last == b->last &&
           a->before_step == b->before_step && a->before_index == b->before_index &&
           a->may_join == b->may_join && a->crc == b->crc && a->crc_error == b->crc_error &&
           a->shift == b->shift && same_received(&a->rx, &b->rx);
}

/* Idle controllers have no past: begin_frame() sets all that a frame needs. */
bool cw_mac_same_point(const cw_mac *a, const cw_mac *b)
{
    if (a->phase != b->phase || a->role != b->role || is_transmitter(a))
        return false;
    if (a->phase == CW_MAC_IDLE)
        return true;
    return same_place(a, b) && a->count == b->count && a->ack_deferred == b->ack_deferred &&
           a->overloads_in_row == b->overloads_in_row;
}

bool cw_mac_reads_along(const cw_mac *m, const cw_mac *sender)
{
    return m->phase == CW_MAC_FRAME && !is_transmitter(m) && cw_mac_is_sending(sender) &&
           same_place(m, sender);
}

void cw_mac_rest(cw_mac *m)
{
    become_idle(m);
}

void cw_mac_go_to_point(cw_mac *m, const cw_mac *there)
{
    assert(!is_transmitter(there));
    m->phase = there->phase;
    m->role = there->role;
    m->step = there->step;
    m->index = there->index;
    m->before_step = there->before_step;
    m->before_index = there->before_index;
    m->count = there->count;
    m->run = there->run;
    m->last = there->last;
    m->driven = there->driven;
    m->started = false;
    m->may_join = there->may_join;
    m->crc_error = there->crc_error;
    m->ack_deferred = there->ack_deferred;
    m->crc = there->crc;
    m->shift = there->shift;
    m->overloads_in_row = there->overloads_in_row;
    m->rx = there->rx;
}

/* What has been decoded when a step begins. */
static void decode_up_to(cw_mac *m, const cw_frame *frame)
{
    bool extended = frame->flags & CW_FRAME_EXTENDED;
    if (m->step > CW_STEP_BASE_ID)
        m->rx.id = extended ? frame->id >> 18 : frame->id;
    if (m->step > CW_STEP_SRR_RTR)
        m->rx.flags = extended ? CW_FRAME_REMOTE : frame->flags; /* as if the SRR was an RTR */
    if (m->step > CW_STEP_IDE && extended)
        m->rx.flags |= CW_FRAME_EXTENDED;
    if (m->step > CW_STEP_EXTENDED_ID)
        m->rx.id = frame->id;
    if (m->step > CW_STEP_RTR)
        m->rx.flags = frame->flags;
    if (m->step > CW_STEP_DLC)
        m->rx.dlc = frame->dlc;
    unsigned bytes = m->step > CW_STEP_DATA ? cw_frame_length(frame) : m->index / 8u;
    if (m->step >= CW_STEP_DATA)
        memcpy(m->rx.data, frame->data, bytes);
}

/* CRC and present field from the first n wire bits. */
static void shift_in(cw_mac *m, const cw_bits *bits, unsigned n, unsigned u)
{
    if (m->step >= CW_STEP_CRC)
        m->crc = bits->crc;
    unsigned field = u - m->index; /* where it begins */
    unsigned wire = m->step >= CW_STEP_CRC ? cw_bits_wire_index(bits, field) : 0;
    for (unsigned k = m->step >= CW_STEP_CRC ? field : 0; wire < n; wire++) {
        bool level = cw_bits_level(bits, wire);
        if (cw_bitset_get(bits->stuff, wire))
            continue;
        if (m->step < CW_STEP_CRC)
            m->crc = cw_crc_next(m->crc, level);
        if (k++ >= field)
            m->shift = m->shift << 1 | level;
    }
}

/* Equal levels in a row at the end of the first n wire bits, as far as those are stuffed. */
static void count_run(cw_mac *m, const cw_bits *bits, unsigned n)
{
    const unsigned tail = 3 + CW_EOF_BITS; /* from the CRC delimiter on */
    n = n < bits->length - tail ? n : bits->length - tail;
    m->last = cw_bits_level(bits, n - 1);
    for (m->run = 1; m->run < n && cw_bits_level(bits, n - 1u - m->run) == m->last;)
        m->run++;
}

void cw_mac_go_into_frame(cw_mac *m, const cw_frame *frame, const cw_bits *bits, unsigned n)
{
    begin_frame(m, CW_ROLE_RECEIVER);
    if (n == 0)
        return;
    if (n >= bits->length) {
        enter(m, CW_MAC_INTERMISSION);
        m->count = (uint8_t)(n - bits->length);
        return;
    }
    unsigned u = n - cw_bitset_count_upto(bits->stuff, n - 1);
    m->step = (uint8_t)cw_bits_step(bits, u, &m->index);
    m->before_step = (uint8_t)cw_bits_step(bits, u - 1, &m->before_index);
    m->may_join = n == 1;
    m->crc_error = false;
    m->shift = 0;
    shift_in(m, bits, n, u);
    count_run(m, bits, n);
    decode_up_to(m, frame);
}

void cw_mac_become_transmitter(cw_mac *m, unsigned bits)
{
    m->role = CW_ROLE_TRANSMITTER;
    m->tx_next = (uint8_t)bits;
    m->may_join = false;
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
