/* SPDX-License-Identifier: MIT
 *
 * quantum_park.c - nodes with clocks of their own between two frames, without their bits.
 *
 * A node that is idle, away, or in the intermission goes on by whole bits. So one moment says where
 * it is: the start of the ACK delimiter of the last frame, or of another bit before. All nodes are
 * parked like this from one clean frame to the next one, and their controllers look idle. When
 * anybody else needs the nodes, each gets its present place.
 */
#include "step/quantum_clean.h"

#include "mac/confinement.h"
#include "mac/mac.h"

#define DELIMITER_BITS 8 /* the ACK delimiter and EOF */
#define BITS_TO_IDLE (DELIMITER_BITS + (cw_span)CW_INTERMISSION_BITS)
#define BITS_KEPT 16 /* a node that is parked for longer is idle in any case */

/* ---- Parking --------------------------------------------------------------------------------- */

static cw_span greater(cw_span a, cw_span b)
{
    return a > b ? a : b;
}

static bool quantum_park_is_away(const cw_mac *m)
{
    return m->phase == CW_MAC_OFF || m->phase == CW_MAC_BUS_OFF || m->phase == CW_MAC_ASLEEP;
}

/* Returns true when a controller between two frames only waits, and a frame changes nothing of it
 * but what it counts. */
static bool only_waits(const cw_mac *m)
{
    const bool between = m->phase == CW_MAC_IDLE || m->phase == CW_MAC_INTERMISSION;
    const bool suspends = m->role == CW_ROLE_TRANSMITTER &&
                          cw_confinement_passive(&m->confinement);
    return between && !suspends && m->confinement.rec == 0 && m->overloads_wanted == 0 &&
           !m->sleeps && m->reported_state == m->confinement.state;
}

/* Returns true when a node is in a recessive bit as long as all others, and saw no edge in it. */
static bool is_in_plain_bit(const cw_timed_node *n, cw_span before)
{
    return !n->retimed && !n->pcs.synchronised && n->pcs.last_sample == CW_RECESSIVE &&
           n->report.what == 0 && n->sync_count == 0 && before < n->begin &&
           n->pcs.sample_at == cw_bit_timing_sample_at(&n->timing) &&
           n->pcs.end_at == cw_bit_timing_quanta(&n->timing);
}

/* Returns true when a node can be parked. No edge moves the bits of one in loopback (M15). */
static bool can_park(const cw_bus *bus, unsigned i)
{
    const cw_cable *cable = &bus->timed.cable;
    const cw_mac *m = &bus->nodes[i].mac;
    const bool stale = m->offered && !(bus->waiting >> i & 1u); /* it is to be dropped */
    return is_in_plain_bit(&bus->timed.nodes[i], cable->newest + cable->longest) && !stale &&
           !(m->modes & CW_MODE_LOOPBACK) && (quantum_park_is_away(m) || only_waits(m));
}

/* Lets the ACK slot of a node end at a moment, with no acknowledgement that comes early. */
static void put_delimiter(cw_clean *clean, cw_clean_node *c, cw_span moment)
{
    c->slot[clean->last] = (cw_clean_slot){.ack = moment - c->bit, .arrival = CW_NO_KEY};
    clean->late_end = clean->most_end = greater(clean->most_end, moment);
}

/* Prepares slots for this. */
static void begin_slots(cw_clean *clean)
{
    clean->slots[clean->last] = (cw_clean_slots){.drivers = UINT64_MAX, .seen = CW_NO_KEY};
    clean->most_end = INT64_MIN;
}

/* Takes the place of a node, and lets its controller look idle. */
static void park_node(cw_bus *bus, unsigned i)
{
    cw_clean *clean = &bus->timed.clean;
    cw_clean_node *c = cw_clean_at(clean, i);
    const cw_timed_node *n = &bus->timed.nodes[i];
    cw_mac *m = &bus->nodes[i].mac;
    const cw_span passed = m->phase == CW_MAC_INTERMISSION ? DELIMITER_BITS + m->count
                                                           : BITS_TO_IDLE;
    const bool sends = m->phase == CW_MAC_INTERMISSION && m->role == CW_ROLE_TRANSMITTER;
    const bool acknowledges = !quantum_park_is_away(m) && !(m->modes & CW_MODE_LISTEN_ONLY) &&
                              !m->no_ack;
    c->origin = n->begin;
    put_delimiter(clean, c, (n->pcs.sampled ? n->next_begin : n->begin) - passed * c->bit);
    clean->drivers |= acknowledges ? cw_node_bit(i) : 0;
    c->down = acknowledges ? c->out[CW_DOMINANT] - c->place : CW_NO_KEY;
    c->up = acknowledges ? c->out[CW_DOMINANT] + c->place : CW_NO_KEY;
    c->quiet = cw_clean_quiet(bus, c);
    clean->senders |= sends ? cw_node_bit(i) : 0;
    clean->away |= quantum_park_is_away(m) ? cw_node_bit(i) : 0;
    if (m->phase == CW_MAC_INTERMISSION)
        cw_mac_go_behind_frame(m, CW_ROLE_RECEIVER, CW_INTERMISSION_BITS);
}

bool cw_clean_park(cw_bus *bus)
{
    cw_clean *clean = &bus->timed.clean;
    if (clean->parked)
        return true;
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_timed_settle(&bus->timed, i);
        if (!can_park(bus, i))
            return false;
    }
    clean->away = clean->senders = clean->drivers = 0;
    begin_slots(clean);
    for (unsigned i = 0; i < bus->node_count; i++)
        park_node(bus, i);
    cw_agenda_clear(&bus->timed.agenda); /* it knows nodes again when they resume */
    clean->parked = true;
    bus->timed.steady_at = CW_NEVER;
    return true;
}

/* ---- Places ---------------------------------------------------------------------------------- */

/* Returns the samples from a bit on up to a moment, the moment included. */
static cw_span samples(cw_span begin, cw_span to_sample, cw_span bit, cw_span moment)
{
    return begin + to_sample > moment ? 0 : (moment - begin - to_sample) / bit + 1;
}

/* A bit that begins at the moment itself is still to begin, as after a bit time. */
unsigned cw_timed_place(cw_bus *bus, unsigned i, cw_span first, cw_span moment)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    const cw_span bit = n->timing.quantum * cw_bit_timing_quanta(&n->timing);
    const cw_span to_sample = n->timing.quantum * cw_bit_timing_sample_at(&n->timing);
    const cw_span sampled = samples(first, to_sample, bit, moment);
    const cw_span begin = first + sampled * bit;
    const bool begun = begin < moment;
    cw_pcs_begin_bit(&n->pcs, &n->timing);
    n->pcs.synchronised = false;
    n->pcs.sampled = !begun;
    n->begin = n->looked = begun ? begin : begin - bit;
    n->next_begin = begun ? begin + bit : begin;
    cw_agenda_put(&bus->timed.agenda, i, begun ? CW_LOOKS : CW_BEGINS,
                  begun ? begin + to_sample : begin);
    return (unsigned)cw_least((uint64_t)sampled, UINT32_MAX);
}

/* ---- Back to single bits --------------------------------------------------------------------- */

/* A margin after the last bit of EOF would count, one after the first bit of intermission does not
 * (T4). */
static void resume_counting(cw_bus *bus, unsigned i, unsigned sampled)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_clean_node *c = cw_clean_at(clean, i);
    cw_sync_record *r = &bus->timed.records[i];
    r->measures = sampled == DELIMITER_BITS && !(clean->away >> i & 1u);
    r->sampled_at = cw_clean_delimiter(clean, i) + (DELIMITER_BITS - 1) * c->bit + c->to_sample;
}

/* Puts a node into the bit in which it is now. */
static void resume_node(cw_bus *bus, unsigned i)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    const unsigned sampled = cw_timed_place(bus, i, cw_clean_delimiter(clean, i), now);
    const cw_role role = clean->senders >> i & 1u ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER;
    bus->timed.nodes[i].ahead = false;
    assert(sampled >= DELIMITER_BITS);
    if (bus->timed.counts)
        resume_counting(bus, i, sampled);
    if (sampled < BITS_TO_IDLE && !(clean->away >> i & 1u))
        cw_mac_go_behind_frame(&bus->nodes[i].mac, role, sampled - DELIMITER_BITS);
}

void cw_clean_resume(cw_bus *bus)
{
    if (!bus->timed.clean.parked)
        return;
    cw_clean_take_counts(bus);
    for (unsigned i = 0; i < bus->node_count; i++)
        resume_node(bus, i);
    bus->timed.moment = cw_moment_of(bus, cw_now(bus));
    bus->timed.clean.parked = false;
}

/* ---- While nodes are parked ------------------------------------------------------------------ */

/* Returns how many bit times to come begin before a moment. */
static uint64_t bits_before(const cw_bus *bus, cw_span moment)
{
    const cw_span left = moment - cw_moment_of(bus, cw_now(bus)), bit = bus->timed.bit_time;
    return left > 0 ? (uint64_t)((left + bit - 1) / bit) : 0;
}

/* Returns the moment at which a node samples the third bit of intermission. */
static cw_span end_of_busy(const cw_clean *clean, unsigned i)
{
    const cw_clean_node *c = cw_clean_at(clean, i);
    return cw_clean_delimiter(clean, i) + (BITS_TO_IDLE - 1) * c->bit + c->to_sample;
}

/* Returns this for the last node. Not inlined, since it is rare. */
__attribute__((noinline)) static cw_span find_end_of_busy(const cw_bus *bus)
{
    const cw_clean *clean = &bus->timed.clean;
    cw_span last = INT64_MIN;
    for (uint64_t rest = bus->all & ~clean->away; rest; rest &= rest - 1)
        last = greater(last, end_of_busy(clean, cw_lowest_node(rest)));
    return last;
}

/* All nodes are near each other, so that the limits of all mostly say it. */
uint64_t cw_clean_busy_bits(const cw_bus *bus)
{
    const cw_clean *clean = &bus->timed.clean;
    const cw_span least = clean->late_end + BITS_TO_IDLE * clean->least_bit - clean->most_behind;
    const cw_span most = clean->most_end + BITS_TO_IDLE * clean->most_bit - clean->least_behind;
    const uint64_t bits = bits_before(bus, most);
    if (bits == 0 || (bits == bits_before(bus, least) && !clean->away))
        return bits;
    return bits_before(bus, find_end_of_busy(bus));
}

bool cw_clean_is_idle(const cw_bus *bus)
{
    return cw_clean_busy_bits(bus) == 0;
}

cw_span cw_clean_ready(const cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_clean_node *c = cw_clean_at(&bus->timed.clean, i);
    const cw_span idle = cw_clean_delimiter(&bus->timed.clean, i) + BITS_TO_IDLE * c->bit;
    return idle >= moment ? idle : idle + (moment - idle + c->bit - 1) / c->bit * c->bit;
}

bool cw_clean_takes_sof(const cw_bus *bus, cw_span moment)
{
    const cw_clean *clean = &bus->timed.clean;
    if (clean->most_end + (BITS_TO_IDLE - 1) * clean->most_bit - clean->least_behind <= moment)
        return true;
    for (unsigned i = 0; i < bus->node_count; i++)
        if (end_of_busy(clean, i) - cw_clean_at(clean, i)->bit > moment)
            return false;
    return true;
}

/* The acknowledgement of the last frame is forgotten, but for the places that it has given. */
void cw_clean_rebase(cw_bus *bus, cw_span by)
{
    cw_clean *clean = &bus->timed.clean;
    cw_span delimiters[CW_NODES_MAX];
    const cw_span now = cw_moment_of(bus, cw_now(bus));
    if (!clean->parked)
        return;
    for (unsigned i = 0; i < bus->node_count; i++)
        delimiters[i] = cw_clean_delimiter(clean, i) - by;
    begin_slots(clean);
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_clean_node *c = cw_clean_at(clean, i);
        const cw_span bits = (now - delimiters[i]) / c->bit;
        const cw_span idle = bits > BITS_KEPT ? (bits - BITS_KEPT) * c->bit : 0;
        put_delimiter(clean, c, delimiters[i] + idle);
        c->origin = c->slot[clean->last].ack;
    }
}

void cw_clean_count_rest(cw_bus *bus, uint64_t bits)
{
    const uint64_t busy = cw_least(cw_clean_busy_bits(bus), bits);
    cw_count_clean_bits(bus);
    cw_clean_count_bits(bus, busy, true);
    cw_clean_count_bits(bus, bits - busy, false);
    bus->stats.bits += bits;
}
