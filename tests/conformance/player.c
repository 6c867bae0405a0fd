/* SPDX-License-Identifier: MIT
 *
 * player.c - plays single bits and compares everything the node does in them.
 */
#include "player.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define TEXT_MAX 160

static void remember(player *b, bool bench_level, bool own, bool level);
static cw_state state_of(unsigned tec, unsigned rec);
static void check_before_sample(player *b, const expect *e, bool own, bool seen_own);
static void check_report(player *b, const cw_mac_report *seen, const expect *e);
static void count(player *b, const expect *e);
static void check_counters(player *b);

void player_init(player *b, bool verbose)
{
    *b = (player){.verbose = verbose};
    for (unsigned i = 0; i < sizeof b->history / sizeof b->history[0]; i++)
        memset(b->history[i], ' ', HISTORY);
    bench_init_node(&b->mac, &b->part, 0);
}

void player_bit(player *b, bool bench_level, bool own, bool forced, expect e)
{
    cw_mac_report report;
    bool seen_own, level;

    if (b->why[0])
        return;
    seen_own = cw_mac_drive(&b->mac);
    check_before_sample(b, &e, own, seen_own);
    level = forced || (seen_own && bench_level);
    cw_mac_sample(&b->mac, level, &report);
    remember(b, bench_level, seen_own, level);
    count(b, &e);
    if (state_of(b->tec, b->rec) != b->state)
        e.what |= CW_REPORT_STATE;
    b->state = state_of(b->tec, b->rec);
    check_report(b, &report, &e);
    check_counters(b);
    if (e.what & (CW_REPORT_TX | CW_REPORT_DROPPED))
        b->pending = false;
    if (!b->why[0])
        b->bit++;
}

void player_fail(player *b, const char *format, ...)
{
    va_list arguments;

    if (b->why[0])
        return;
    va_start(arguments, format);
    vsnprintf(b->why, sizeof b->why, format, arguments);
    va_end(arguments);
}

static void shift_in(char *row, char c)
{
    memmove(row, row + 1, HISTORY - 1);
    row[HISTORY - 1] = c;
}

static void remember(player *b, bool bench_level, bool own, bool level)
{
    shift_in(b->history[0], bench_level ? 'r' : 'd');
    shift_in(b->history[1], own ? 'r' : 'd');
    shift_in(b->history[2], level ? 'r' : 'd');
    if (b->verbose) {
        printf("%4u bench %c node %c bus %c tec %u rec %u phase %d\n", b->bit,
               bench_level ? 'r' : 'd', own ? 'r' : 'd', level ? 'r' : 'd', cw_mac_tec(&b->mac),
               cw_mac_rec(&b->mac), (int)cw_mac_get_phase(&b->mac));
    }
}

static const char *report_text(char *buffer, uint16_t what, unsigned lost_bit,
                               const cw_error *error)
{
    static const char *const words[] = {"start", "lost",  "error", "ovl", "rx",
                                        "tx",    "state", "drop",  "tol", "exc"};
    static const char *const types[] = {"bit", "stuff", "form", "crc", "ack"};
    static const char *const roles[] = {"none", "rx", "tx"};
    static const char *const flags[] = {"none", "act", "pas"};
    char place[NAME_MAX_LENGTH];
    size_t used = 0;

    snprintf(buffer, TEXT_MAX, "nothing");
    for (unsigned i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (what >> i & 1)
            used += (size_t)snprintf(buffer + used, TEXT_MAX - used, "%s ", words[i]);
    }
    if (what & CW_REPORT_ARBITRATION_LOST)
        used += (size_t)snprintf(buffer + used, TEXT_MAX - used, "bit %u ", lost_bit);
    if (what & CW_REPORT_ERROR) {
        snprintf(buffer + used, TEXT_MAX - used, "(%s %s %s %s)",
                 types[error->type % CW_ERROR_COUNT], wire_place_text(place, error->place),
                 roles[error->role % 3], flags[error->flag % 3]);
    }
    return buffer;
}

static cw_state state_of(unsigned tec, unsigned rec)
{
    unsigned worst = tec > rec ? tec : rec;

    if (tec >= BUS_OFF_LIMIT)
        return CW_STATE_BUS_OFF;
    if (worst >= PASSIVE_LIMIT)
        return CW_STATE_ERROR_PASSIVE;
    return worst >= WARNING_LIMIT ? CW_STATE_ERROR_WARNING : CW_STATE_ERROR_ACTIVE;
}

/* Compares places. Before the IDE bit a controller cannot distinguish RTR and SRR. A reserved bit
 * may be FDF until it has been seen. For a receiver it does not matter. */
static bool place_matches(cw_place seen, cw_place expected, cw_role role)
{
    bool reserved = seen.field == CW_FIELD_R1 || seen.field == CW_FIELD_R0;

    if (role != CW_ROLE_TRANSMITTER && expected.field == CW_FIELD_SRR && seen.field == CW_FIELD_RTR)
        seen.field = CW_FIELD_SRR;
    if (role != CW_ROLE_TRANSMITTER && expected.field == CW_FIELD_FDF && reserved)
        seen.field = CW_FIELD_FDF;
    return wire_same_place(seen, expected);
}

static bool error_matches(const cw_error *seen, const cw_error *expected)
{
    return seen->type == expected->type && seen->role == expected->role &&
           seen->flag == expected->flag &&
           place_matches(seen->place, expected->place, expected->role);
}

/* Compares counters; the role tells which one moved. */
static bool tolerance_matches(const cw_error *seen, const expect *e)
{
    cw_field field = seen->place.field;

    return seen->role == (e->tec_change ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER) &&
           (field == CW_FIELD_ERROR_FLAG || field == CW_FIELD_ERROR_DELIMITER ||
            field == CW_FIELD_OVERLOAD_DELIMITER);
}

/* Returns the reason of a drop. M13 precedes R10: the only attempt of a node (L1, too) ends with
 * the error that leads to bus-off. */
static cw_drop drop_reason(const player *b, const expect *e)
{
    const unsigned once = CW_MODE_ONE_SHOT | CW_MODE_TIME_TRIGGERED;
    bool attempt_ends = e->what & (CW_REPORT_ERROR | CW_REPORT_ARBITRATION_LOST);
    return attempt_ends && (b->modes & once) ? CW_DROP_ONE_SHOT : CW_DROP_BUS_OFF;
}

static void check_report(player *b, const cw_mac_report *seen, const expect *e)
{
    char expected_text[TEXT_MAX], seen_text[TEXT_MAX];
    bool same = seen->what == e->what;

    if (same && (e->what & CW_REPORT_ERROR))
        same = error_matches(&seen->error, &e->error);
    if (same && (e->what & CW_REPORT_ARBITRATION_LOST))
        same = seen->lost_bit == e->lost_bit;
    if (!same) {
        player_fail(b, "expected %s, reported %s",
                    report_text(expected_text, e->what, e->lost_bit, &e->error),
                    report_text(seen_text, seen->what, seen->lost_bit, &seen->error));
    }
    if (same && (e->what & CW_REPORT_TOLERATED) && !tolerance_matches(&seen->error, e))
        player_fail(b, "tolerated bits with another role or place");
    if (same && (e->what & CW_REPORT_DROPPED) && seen->why != drop_reason(b, e))
        player_fail(b, "dropped for reason %u", seen->why);
    if (same && (e->what & CW_REPORT_RX)) {
        if (!bench_same_frame(cw_mac_received(&b->mac), &b->wire.frame))
            player_fail(b, "another frame was received than was sent");
    }
}

static void count(player *b, const expect *e)
{
    b->tec = e->zero ? 0 : (unsigned)((int)b->tec + e->tec_change);
    b->rec = e->zero ? 0 : (unsigned)((int)b->rec + e->rec_change);
}

static void check_counters(player *b)
{
    unsigned tec = cw_mac_tec(&b->mac), rec = cw_mac_rec(&b->mac);

    if (tec != b->tec || rec != b->rec)
        player_fail(b, "expected TEC %u REC %u, they are %u and %u", b->tec, b->rec, tec, rec);
    if (cw_mac_state(&b->mac) != b->state)
        player_fail(b, "expected state %d, it is %d", (int)b->state, (int)cw_mac_state(&b->mac));
}

static void check_before_sample(player *b, const expect *e, bool own, bool seen_own)
{
    char expected_place[NAME_MAX_LENGTH], seen_place[NAME_MAX_LENGTH];
    cw_place place = cw_mac_place(&b->mac);
    cw_role role = b->sender == BY_NODE ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER;

    if (seen_own != own)
        player_fail(b, "expected the node to drive %c, it drives %c", own ? 'r' : 'd',
                    seen_own ? 'r' : 'd');
    if (e->check_place && !place_matches(place, e->place, role))
        player_fail(b, "expected place %s, it is %s", wire_place_text(expected_place, e->place),
                    wire_place_text(seen_place, place));
    if (e->check_place && e->place.field == CW_FIELD_NONE && cw_mac_role(&b->mac) != CW_ROLE_NONE)
        player_fail(b, "expected no role, it is %d", (int)cw_mac_role(&b->mac));
    if (!e->check_role)
        return;
    if (cw_mac_role(&b->mac) != role)
        player_fail(b, "expected role %d, it is %d", (int)role, (int)cw_mac_role(&b->mac));
    if (cw_mac_is_sending(&b->mac) != (b->sender == BY_NODE))
        player_fail(b, "expected sending %d", b->sender == BY_NODE);
}
