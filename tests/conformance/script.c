/* SPDX-License-Identifier: MIT
 *
 * script.c - reads scripts (bench.h) and plays them.
 */
#include "player.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WORD_MAX 16
#define TOKEN_SHOWN 40
#define REC_AFTER_PASSIVE 120u /* ruling in R8 */
#define INTEGRATION "r11 "
#define CLOSING "r11 <2A5#C3 r11 " /* 11 recessive bits end every debt of a sound node */

static const char *play(player *b, const char *p, const char *end);

static void play_all(player *b, const char *text)
{
    play(b, text, text + strlen(text));
}

void player_run(player *b, const char *script)
{
    b->token = script;
    if (strncmp(script, "init=", 5) != 0)
        play_all(b, INTEGRATION);
    play_all(b, script);
    if (!b->away)
        play_all(b, CLOSING);
}

/* ---- What is expected in brackets ------------------------------------------------------------ */

static const char *next_word(char *word, const char *p)
{
    size_t length;

    p += strspn(p, " ");
    length = strcspn(p, " )");
    snprintf(word, WORD_MAX, "%.*s", (int)length, p);
    return p + length;
}

/* Returns the index of the word in a list, or -1. */
static int find_word(const char *const *list, const char *word)
{
    for (int i = 0; list[i]; i++) {
        if (strcmp(list[i], word) == 0)
            return i;
    }
    return -1;
}

static const char *parse_error(player *b, cw_error *out, int type, const char *p)
{
    static const char *const roles[] = {"none", "rx", "tx", NULL};
    static const char *const flags[] = {"none", "act", "pas", NULL};
    char place[WORD_MAX], role[WORD_MAX], flag[WORD_MAX];
    int nth;

    p = next_word(place, p);
    p = next_word(role, p);
    p = next_word(flag, p);
    *out = (cw_error){.type = (cw_error_type)type};
    if (strcmp(place, "here") == 0)
        out->place = b->wire.bit[b->next].place;
    else if (!wire_parse_place(&out->place, &nth, place) || nth >= 0)
        player_fail(b, "script: bad place %s", place);
    if (find_word(roles, role) < 0 || find_word(flags, flag) < 0)
        player_fail(b, "script: bad error %s %s", role, flag);
    out->role = (cw_role)find_word(roles, role);
    out->flag = (cw_flag)find_word(flags, flag);
    return p;
}

static const char *parse_at(player *b, expect *e, const char *p)
{
    char place[WORD_MAX];
    int nth;

    p = next_word(place, p);
    e->check_place = true;
    if (!wire_parse_place(&e->place, &nth, place) || nth >= 0)
        player_fail(b, "script: bad place %s", place);
    return p;
}

static void parse_counter(player *b, expect *e, const char *word)
{
    int change = atoi(word + 1);

    if (word[1] == '=')
        e->zero = true;
    else if (word[0] == 'T')
        e->tec_change += change;
    else if (word[0] == 'R')
        e->rec_change += change;
    else
        player_fail(b, "script: bad word %s", word);
}

/* Reads what stands in brackets at p, if anything, into *e. Returns where it ends. */
static const char *parse_expect(player *b, expect *e, const char *p)
{
    static const char *const types[] = {"bit", "stuff", "form", "crc", "ack", NULL};
    static const char *const events[] = {"start", "lost",  "",    "ovl", "rx", "tx",
                                         "",      "drop", "tol", "exc", NULL};
    char word[WORD_MAX];

    if (*p != '(')
        return p;
    for (p = next_word(word, p + 1); word[0]; p = next_word(word, p)) {
        if (find_word(types, word) >= 0) {
            e->what |= CW_REPORT_ERROR;
            p = parse_error(b, &e->error, find_word(types, word), p);
        } else if (find_word(events, word) >= 0) {
            e->what |= (uint16_t)(1u << find_word(events, word));
        } else if (strcmp(word, "at") == 0) {
            p = parse_at(b, e, p);
        } else if (strncmp(word, "lost", 4) == 0) {
            e->what |= CW_REPORT_ARBITRATION_LOST;
            e->lost_bit = (unsigned)atoi(word + 4);
        } else {
            parse_counter(b, e, word);
        }
    }
    return p + (*p == ')');
}

/* ---- Frames ---------------------------------------------------------------------------------- */

static void offer(player *b, const cw_frame *frame)
{
    if (cw_mac_offer(&b->mac, frame) != CW_OK)
        player_fail(b, "the offer was refused");
    b->pending = true;
}

static int rec_change_of_success(unsigned rec)
{
    if (rec >= PASSIVE_LIMIT)
        return (int)REC_AFTER_PASSIVE - (int)rec;
    return rec > 0 ? -1 : 0;
}

static bool acknowledges(const player *b)
{
    return b->sender == BY_BENCH && !b->wire.crc_wrong;
}

/* D19 freezes the counters, too. */
static bool is_frozen(const player *b)
{
    return (b->modes & (CW_MODE_LISTEN_ONLY | CW_MODE_RESTRICTED)) != 0;
}

/* Returns the undisturbed behaviour in bit n of the present frame. */
static expect expect_of(const player *b, unsigned n)
{
    const wire_bit *bit = &b->wire.bit[n];
    expect e = {.place = bit->place};

    e.check_role = b->sender != BY_NOBODY_KNOWN && (n > 0 || b->sender == BY_NODE);
    e.check_place = e.check_role && !b->wire.no_sof;
    if (b->sender == BY_NODE && n == 0)
        e.what = CW_REPORT_STARTED;
    if (b->sender == BY_NODE && n + 1 == b->wire.length) {
        e.what = CW_REPORT_TX;
        e.tec_change = b->tec > 0 ? -1 : 0;
    }
    if (acknowledges(b) && n == b->wire.ack && !is_frozen(b))
        e.rec_change = rec_change_of_success(b->rec);
    if ((acknowledges(b) || (b->modes & CW_MODE_LOOPBACK)) && n + 2 == b->wire.length)
        e.what = CW_REPORT_RX;
    return e;
}

/* Returns the node's own level in bit n of the present frame. */
static bool own_level(const player *b, unsigned n)
{
    if (b->sender == BY_NODE)
        return b->wire.bit[n].level || (b->modes & CW_MODE_LOOPBACK);
    return !(acknowledges(b) && n == b->wire.ack && !(b->modes & CW_MODE_LISTEN_ONLY));
}

static bool bench_level(const player *b, unsigned n)
{
    if (b->sender == BY_NODE)
        return n != b->wire.ack;
    return b->sender == BY_NOBODY_KNOWN && n == b->wire.ack ? false : b->wire.bit[n].level;
}

static void play_wire(player *b, unsigned to, bool joins)
{
    for (; b->next < to && !b->why[0]; b->next++) {
        expect e = expect_of(b, b->next);
        if (joins)
            e.what |= CW_REPORT_STARTED;
        player_bit(b, bench_level(b, b->next), own_level(b, b->next), false, e);
        joins = false;
    }
}

static const char *parse_range(player *b, unsigned *from, unsigned *to, const char *p)
{
    const char *end = p;
    int at;

    *from = 0;
    *to = b->wire.length;
    for (; *p == '@' || *p == ':'; p = end) {
        at = wire_find(&b->wire, p + 1, &end);
        if (at < 0) {
            player_fail(b, "script: the frame has no bit %.*s", TOKEN_SHOWN, p + 1);
            return p + strcspn(p, " ");
        }
        *(*p == '@' ? from : to) = (unsigned)at;
    }
    return p;
}

/* D8: the node sends its error state. */
static const char *parse_own(const player *b, wire *w, const char *p)
{
    return wire_parse_sent(w, p, b->tec >= PASSIVE_LIMIT || b->rec >= PASSIVE_LIMIT);
}

static const char *play_frame(player *b, const char *p)
{
    char kind = *p;
    unsigned from, to;
    const char *end = kind == '>' ? parse_own(b, &b->wire, p + 1) : wire_parse(&b->wire, p + 1);

    if (!end) {
        player_fail(b, "script: malformed frame, or the encoders disagree");
        return p + strcspn(p, " ");
    }
    end = parse_range(b, &from, &to, end);
    b->sender = kind == '>' ? BY_NODE : kind == '<' ? BY_BENCH : BY_NOBODY_KNOWN;
    b->next = from;
    if (kind == '>' && !b->pending)
        offer(b, &b->wire.frame);
    play_wire(b, to,
              kind == '>' && b->wire.bit[from].place.field == CW_FIELD_ID &&
                  b->wire.bit[from].place.index == 0);
    return end;
}

/* Plays two senders; the node goes on with the bench's frame behind the bit that it lost. */
static void play_contest(player *b, const wire *bench_wire, unsigned from, unsigned to)
{
    unsigned lost = from;
    expect e;

    while (b->wire.bit[lost].level == bench_wire->bit[lost].level)
        lost++;
    if (!b->wire.bit[lost].level || !b->wire.bit[lost].arbitration ||
        b->wire.bit[lost].place.stuff) {
        player_fail(b, "script: the node does not lose arbitration");
        return;
    }
    play_wire(b, lost, from > 0);
    e = expect_of(b, lost);
    e.what |= CW_REPORT_ARBITRATION_LOST;
    if (from > 0 && lost == from) /* joined and lost in one bit */
        e.what |= CW_REPORT_STARTED;
    if (b->modes & (CW_MODE_ONE_SHOT | CW_MODE_TIME_TRIGGERED))
        e.what |= CW_REPORT_DROPPED;
    e.lost_bit = wire_lost_bit(&b->wire, lost);
    player_bit(b, false, true, false, e);
    b->wire = *bench_wire;
    b->sender = BY_BENCH;
    b->next = lost + 1;
    play_wire(b, to, false);
}

static const char *play_contest_token(player *b, const char *p)
{
    wire own, bench_wire;
    unsigned from, to;
    const char *end = parse_own(b, &own, p + 1);

    if (!end || *end != '/' || !(end = wire_parse(&bench_wire, end + 1))) {
        player_fail(b, "script: malformed frames");
        return p + strcspn(p, " ");
    }
    b->wire = bench_wire;
    end = parse_range(b, &from, &to, end);
    b->wire = own;
    b->sender = BY_NODE;
    b->next = from;
    if (!b->pending)
        offer(b, &own.frame);
    play_contest(b, &bench_wire, from, to);
    return end;
}

static const char *play_inverted(player *b, const char *p)
{
    bool level = b->wire.bit[b->next].level;
    bool own = own_level(b, b->next);
    expect e = {0};

    if (b->sender == BY_NODE && b->next == 0)
        e.what = CW_REPORT_STARTED;
    p = parse_expect(b, &e, p + 1);
    player_bit(b, !level, own, !own, e);
    b->next++;
    return p;
}

/* ---- Single bits and commands ---------------------------------------------------------------- */

static const char *play_bits(player *b, const char *p)
{
    char kind = *p++;
    char *end;
    unsigned n = 1;
    expect e = {0};

    if (*p >= '0' && *p <= '9') {
        n = (unsigned)strtoul(p, &end, 10);
        p = end;
    }
    p = parse_expect(b, &e, p);
    for (unsigned i = 0; i < n; i++) {
        player_bit(b, kind != 'd' && kind != 'B', kind == 'r' || kind == 'd', kind == 'X',
                   i + 1 == n ? e : (expect){0});
    }
    return p;
}

static unsigned parse_modes(const char *p)
{
    unsigned modes = 0;

    for (; *p && *p != ' '; p++) {
        modes |= *p == 'O' ? CW_MODE_ONE_SHOT : 0;
        modes |= *p == 'L' ? CW_MODE_LISTEN_ONLY : 0;
        modes |= *p == 'B' ? CW_MODE_LOOPBACK : 0;
        modes |= *p == 'A' ? CW_MODE_PRESUME_ACK : 0;
        modes |= *p == 'R' ? CW_MODE_RESTRICTED : 0;
        modes |= *p == 'T' ? CW_MODE_TIME_TRIGGERED : 0;
    }
    return modes;
}

static void do_init(player *b, const char *p)
{
    b->modes = parse_modes(p);
    bench_init_node(&b->mac, &b->part, b->modes);
}

static void do_protocol(player *b, const char *p)
{
    unsigned protocol = *p == 'F' ? CW_FD : *p == 'T' ? CW_FD_TOLERANT : CW_CLASSICAL;

    for (p++; *p && *p != ' '; p++) {
        protocol |= *p == 'x' ? CW_PROTOCOL_NO_EXCEPTION : 0;
        protocol |= *p == 'n' ? CW_PROTOCOL_NON_ISO : 0;
    }
    b->pending = false;
    if (cw_mac_set_protocol(&b->mac, protocol,
                            (protocol & CW_PROTOCOL_MASK) == CW_FD ? &b->part : NULL) != CW_OK)
        player_fail(b, "the protocol was refused");
}

static void do_modes(player *b, const char *p)
{
    b->modes = parse_modes(p);
    cw_mac_set_modes(&b->mac, b->modes);
}

static void do_set(player *b, const char *p)
{
    char *end;

    b->tec = (unsigned)strtoul(p, &end, 10);
    b->rec = (unsigned)strtoul(end + 1, NULL, 10);
    if (cw_mac_set_counters(&b->mac, b->tec, b->rec) != CW_OK)
        player_fail(b, "the counters cannot be preset");
}

static void do_offer(player *b, const char *p)
{
    wire w;

    if (wire_parse(&w, p))
        offer(b, &w.frame);
    else
        player_fail(b, "script: malformed frame");
}

static void do_refuse(player *b, const char *p)
{
    wire w;

    if (!wire_parse(&w, p) || cw_mac_offer(&b->mac, &w.frame) != CW_REFUSED)
        player_fail(b, "the offer was not refused");
}

static void do_withdraw(player *b, const char *p)
{
    (void)p;
    if (cw_mac_withdraw(&b->mac) != CW_OK)
        player_fail(b, "the frame cannot be withdrawn");
    b->pending = false;
}

static void do_no_withdraw(player *b, const char *p)
{
    (void)p;
    if (cw_mac_withdraw(&b->mac) != CW_REFUSED)
        player_fail(b, "a frame on the wire was withdrawn");
}

static void do_restart(player *b, const char *p)
{
    (void)p;
    if (cw_mac_request_restart(&b->mac) != CW_OK)
        player_fail(b, "the restart was refused");
}

static void do_no_restart(player *b, const char *p)
{
    (void)p;
    if (cw_mac_request_restart(&b->mac) != CW_REFUSED)
        player_fail(b, "the restart was not refused");
}

static void do_overload(player *b, const char *p)
{
    if (cw_mac_request_overload(&b->mac, (unsigned)atoi(p)) != CW_OK)
        player_fail(b, "the overload frames were refused");
}

static void do_disconnect(player *b, const char *p)
{
    (void)p;
    cw_mac_disconnect(&b->mac);
}

static void do_reconnect(player *b, const char *p)
{
    (void)p;
    cw_mac_reconnect(&b->mac);
}

static void do_away(player *b, const char *p)
{
    (void)p;
    b->away = true;
}

static const struct {
    const char *word;
    void (*run)(player *b, const char *argument);
} commands[] = {
    {"set=", do_set},
    {"offer=", do_offer},
    {"refuse=", do_refuse},
    {"withdraw", do_withdraw},
    {"restart", do_restart},
    {"overload=", do_overload},
    {"modes=", do_modes},
    {"protocol=", do_protocol},
    {"init=", do_init},
    {"away", do_away},
    {"disconnect", do_disconnect},
    {"reconnect", do_reconnect},
    {"no-restart", do_no_restart},
    {"no-withdraw", do_no_withdraw},
};

static const char *play_command(player *b, const char *p)
{
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        size_t length = strlen(commands[i].word);
        if (strncmp(commands[i].word, p, length) == 0) {
            commands[i].run(b, p + length);
            return p + strcspn(p, " ");
        }
    }
    player_fail(b, "script: unknown token");
    return p + strcspn(p, " ");
}

/* ---- Scripts --------------------------------------------------------------------------------- */

static const char *matching_bracket(const char *p, const char *end)
{
    unsigned depth = 0;

    for (; p < end; p++) {
        depth += *p == '[';
        depth -= *p == ']';
        if (*p == ']' && depth == 0)
            return p;
    }
    return NULL;
}

static const char *play_repeated(player *b, const char *p, const char *end)
{
    char *open;
    unsigned n = (unsigned)strtoul(p, &open, 10);
    const char *close = *open == '[' ? matching_bracket(open, end) : NULL;

    if (!close) {
        player_fail(b, "script: no brackets after the number");
        return end;
    }
    for (unsigned i = 0; i < n && !b->why[0]; i++)
        play(b, open + 1, close);
    return close + 1;
}

static const char *play_token(player *b, const char *p, const char *end)
{
    if (*p == '+')
        return wire_is_fd() ? p + 1 : p + strcspn(p, " ");
    bool digit_follows = (p[1] >= '0' && p[1] <= '9');
    bool alone = p + 1 == end || strchr(" (]", p[1]);

    if (strchr("rdDXB", *p) && (digit_follows || alone))
        return play_bits(b, p);
    if (strchr("<>-", *p))
        return play_frame(b, p);
    if (*p == '*')
        return play_contest_token(b, p);
    if (*p == '~')
        return play_inverted(b, p);
    if (*p >= '0' && *p <= '9')
        return play_repeated(b, p, end);
    return play_command(b, p);
}

static const char *play(player *b, const char *p, const char *end)
{
    while (p < end && !b->why[0]) {
        if (*p == ' ') {
            p++;
            continue;
        }
        b->token = p;
        p = play_token(b, p, end);
    }
    return p;
}
