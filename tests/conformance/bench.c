/* SPDX-License-Identifier: MIT
 *
 * bench.c - plays scripts (bench.h) against one controller and compares every bit.
 */
#include "bench.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HISTORY 40
#define WORD_MAX 16
#define TOKEN_SHOWN 40
#define ALTERNATIVES_MAX 64
#define WARNING_LIMIT 96u
#define PASSIVE_LIMIT 128u
#define BUS_OFF_LIMIT 256u
#define REC_AFTER_PASSIVE 119u /* ruling in R8 */
#define INTEGRATION "r11 "
#define CLOSING "r11 <2A5#C3 r11 " /* 11 recessive bits end every debt of a sound node */

/* What the node has to report in one bit. */
typedef struct expect {
    uint16_t what;
    unsigned lost_bit;
    cw_error error;
    int tec_change;
    int rec_change;
    bool zero; /* T=0 R=0 */
    bool check_place;
    cw_place place;
} expect;

typedef enum sender { BY_NODE, BY_BENCH, BY_NOBODY_KNOWN } sender;

typedef struct bench {
    cw_mac mac;
    unsigned tec, rec; /* expected */
    cw_state state;    /* as reported last */
    unsigned modes;
    bool pending; /* the node has an offer, as far as we expect */
    bool away;
    wire wire;     /* the present frame ... */
    unsigned next; /* ... its next bit ... */
    sender sender; /* ... and who sends it */
    unsigned bit;
    char history[3][HISTORY + 1]; /* bench, node, bus */
    char why[400];
    const char *token; /* where we are in the script */
} bench;

static struct {
    const char *number;
    unsigned *passed, *failed;
    unsigned elementary;
    bool verbose;
    uint32_t random;
} run;

static void run_one(const char *script);
static void expand(const char *script);
static const char *play(bench *b, const char *p, const char *end);
static const char *play_token(bench *b, const char *p, const char *end);

void bench_begin(const char *number, unsigned *passed, unsigned *failed)
{
    run.number = number;
    run.passed = passed;
    run.failed = failed;
    run.elementary = 0;
    run.random = 0x2545F491;
}

void bench_set_verbose(bool verbose)
{
    run.verbose = verbose;
}

uint32_t bench_random(void)
{
    run.random ^= run.random << 13;
    run.random ^= run.random >> 17;
    run.random ^= run.random << 5;
    return run.random;
}

void bench_run(const char *format, ...)
{
    char script[SCRIPT_MAX];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(script, sizeof script, format, arguments);
    va_end(arguments);
    expand(script);
}

void bench_count(const char *why)
{
    run.elementary++;
    if (!why) {
        ++*run.passed;
        return;
    }
    ++*run.failed;
    printf("FAILED %s, elementary test %u: %s\n", run.number, run.elementary, why);
}

bool bench_same_frame(const cw_frame *a, const cw_frame *b)
{
    unsigned bytes = a->dlc < 8 ? a->dlc : 8;

    if (a->flags & CW_FRAME_REMOTE)
        bytes = 0;
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, bytes) == 0;
}

void bench_run_frames(char kind, bool extended)
{
    static const uint32_t ids[2][4] = {{0x555, 0x2AA, 0, 0x7FF},
                                       {0x15555555, 0x0AAAAAAA, 0, 0x1FFFFFFF}};

    for (unsigned n = 0; n < 45; n++) {
        char data[17] = "";
        uint32_t id = n < 36 ? ids[extended][n / 9] : bench_random() & ids[extended][3];
        for (unsigned i = 0; i < n % 9; i++)
            snprintf(data + 2 * i, 3, "%02X", bench_random() & 0xFF);
        bench_run("%c%0*X#%s r3", kind, extended ? 8 : 3, id, data);
    }
}

void bench_run_stuff_bits(char kind, const char *frame, const char *(*tail)(const wire_bit *bit))
{
    wire w;
    unsigned nth = 0;

    if (!wire_parse(&w, frame))
        bench_count("malformed frame");
    for (unsigned i = 0; i < w.length; i++) {
        if (w.bit[i].place.stuff)
            bench_run("%c%s:st%u ~%s%c%s r3", kind, frame, nth++, tail(&w.bit[i]), kind, frame);
    }
}

/* ---- Alternatives ---------------------------------------------------------------------------- */

/* Copies the k-th alternative of every {...}. Returns false when one of them has no k-th. */
static bool expand_one(char *out, const char *script, unsigned k)
{
    const char *p = script;

    while (*p) {
        if (*p != '{') {
            *out++ = *p++;
            continue;
        }
        p++;
        for (unsigned i = 0; i < k; p++) {
            if (*p == '}' || *p == 0)
                return false;
            i += *p == '|';
        }
        while (*p != '|' && *p != '}')
            *out++ = *p++;
        p = strchr(p, '}') + 1;
    }
    *out = 0;
    return true;
}

static void expand(const char *script)
{
    char one[SCRIPT_MAX];
    bool braces = strchr(script, '{') != NULL;

    for (unsigned k = 0; k < ALTERNATIVES_MAX && expand_one(one, script, k); k++) {
        run_one(one);
        if (!braces)
            break;
    }
}

/* ---- Failures -------------------------------------------------------------------------------- */

static void fail(bench *b, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void fail(bench *b, const char *format, ...)
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

static void remember(bench *b, bool bench_level, bool own, bool level)
{
    shift_in(b->history[0], bench_level ? 'r' : 'd');
    shift_in(b->history[1], own ? 'r' : 'd');
    shift_in(b->history[2], level ? 'r' : 'd');
    if (run.verbose) {
        printf("%4u bench %c node %c bus %c tec %u rec %u phase %d\n", b->bit,
               bench_level ? 'r' : 'd', own ? 'r' : 'd', level ? 'r' : 'd', cw_mac_tec(&b->mac),
               cw_mac_rec(&b->mac), (int)cw_mac_get_phase(&b->mac));
    }
}

static void report_failure(const bench *b, const char *script)
{
    printf("FAILED %s, elementary test %u, bit %u, at \"%.*s\": %s\n", run.number, run.elementary,
           b->bit, TOKEN_SHOWN, b->token, b->why);
    printf("    script: %s\n", script);
    printf("    bench %s\n    node  %s\n    bus   %s\n", b->history[0], b->history[1],
           b->history[2]);
}

static const char *report_text(char *buffer, size_t size, uint16_t what, unsigned lost_bit,
                               const cw_error *error)
{
    static const char *const words[] = {"start", "lost", "error", "ovl", "rx",
                                        "tx",    "state", "drop", "tol"};
    static const char *const types[] = {"bit", "stuff", "form", "crc", "ack"};
    static const char *const roles[] = {"none", "rx", "tx"};
    static const char *const flags[] = {"none", "act", "pas"};
    char place[NAME_MAX_LENGTH];
    size_t used = 0;

    snprintf(buffer, size, "nothing");
    for (unsigned i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (what >> i & 1)
            used += (size_t)snprintf(buffer + used, size - used, "%s ", words[i]);
    }
    if (what & CW_REPORT_ARBITRATION_LOST)
        used += (size_t)snprintf(buffer + used, size - used, "bit %u ", lost_bit);
    if (what & CW_REPORT_ERROR) {
        snprintf(buffer + used, size - used, "(%s %s %s %s)", types[error->type % CW_ERROR_COUNT],
                 wire_place_text(place, error->place), roles[error->role % 3],
                 flags[error->flag % 3]);
    }
    return buffer;
}

/* ---- One bit --------------------------------------------------------------------------------- */

static cw_state state_of(unsigned tec, unsigned rec)
{
    unsigned worst = tec > rec ? tec : rec;

    if (tec >= BUS_OFF_LIMIT)
        return CW_STATE_BUS_OFF;
    if (worst >= PASSIVE_LIMIT)
        return CW_STATE_ERROR_PASSIVE;
    return worst >= WARNING_LIMIT ? CW_STATE_ERROR_WARNING : CW_STATE_ERROR_ACTIVE;
}

/* Before the IDE bit nobody can tell RTR from SRR (nor, for a receiver, should it matter). */
static bool place_matches(cw_place seen, cw_place expected, cw_role role)
{
    if (role != CW_ROLE_TRANSMITTER && expected.field == CW_FIELD_SRR && seen.field == CW_FIELD_RTR)
        seen.field = CW_FIELD_SRR;
    return wire_same_place(seen, expected);
}

static bool error_matches(const cw_error *seen, const cw_error *expected)
{
    return seen->type == expected->type && seen->role == expected->role &&
           seen->flag == expected->flag &&
           place_matches(seen->place, expected->place, expected->role);
}

static void check_report(bench *b, const cw_mac_report *seen, const expect *e)
{
    char expected_text[160], seen_text[160];
    bool same = seen->what == e->what;

    if (same && (e->what & CW_REPORT_ERROR))
        same = error_matches(&seen->error, &e->error);
    if (same && (e->what & CW_REPORT_ARBITRATION_LOST))
        same = seen->lost_bit == e->lost_bit;
    if (!same) {
        fail(b, "expected %s, reported %s",
             report_text(expected_text, sizeof expected_text, e->what, e->lost_bit, &e->error),
             report_text(seen_text, sizeof seen_text, seen->what, seen->lost_bit, &seen->error));
    }
    if (same && (e->what & CW_REPORT_RX)) {
        if (!bench_same_frame(cw_mac_received(&b->mac), &b->wire.frame))
            fail(b, "another frame was received than was sent");
    }
}

static void count(bench *b, const expect *e)
{
    b->tec = e->zero ? 0 : (unsigned)((int)b->tec + e->tec_change);
    b->rec = e->zero ? 0 : (unsigned)((int)b->rec + e->rec_change);
}

static void check_counters(bench *b)
{
    unsigned tec = cw_mac_tec(&b->mac), rec = cw_mac_rec(&b->mac);

    if (tec != b->tec || rec != b->rec)
        fail(b, "expected TEC %u REC %u, they are %u and %u", b->tec, b->rec, tec, rec);
    if (cw_mac_state(&b->mac) != b->state)
        fail(b, "expected state %d, it is %d", (int)b->state, (int)cw_mac_state(&b->mac));
}

static void check_before_sample(bench *b, const expect *e, bool own, bool seen_own)
{
    char expected_place[NAME_MAX_LENGTH], seen_place[NAME_MAX_LENGTH];
    cw_place place = cw_mac_place(&b->mac);
    cw_role role = b->sender == BY_NODE ? CW_ROLE_TRANSMITTER : CW_ROLE_RECEIVER;

    if (seen_own != own)
        fail(b, "expected the node to drive %c, it drives %c", own ? 'r' : 'd',
             seen_own ? 'r' : 'd');
    if (!e->check_place)
        return;
    if (!place_matches(place, e->place, role))
        fail(b, "expected place %s, it is %s", wire_place_text(expected_place, e->place),
             wire_place_text(seen_place, place));
    if (cw_mac_role(&b->mac) != role)
        fail(b, "expected role %d, it is %d", (int)role, (int)cw_mac_role(&b->mac));
    if (cw_mac_is_sending(&b->mac) != (b->sender == BY_NODE))
        fail(b, "expected sending %d", b->sender == BY_NODE);
}

/* Plays one bit; forced puts recessive onto the bus whatever the node drives. */
static void bit(bench *b, bool bench_level, bool own, bool forced, expect e)
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

/* ---- What is expected in brackets ------------------------------------------------------------ */

static const char *next_word(char *word, const char *p)
{
    size_t length;

    p += strspn(p, " ");
    length = strcspn(p, " )");
    snprintf(word, WORD_MAX, "%.*s", (int)length, p);
    return p + length;
}

/* Index of the word in a list, or -1. */
static int find_word(const char *const *list, const char *word)
{
    for (int i = 0; list[i]; i++) {
        if (strcmp(list[i], word) == 0)
            return i;
    }
    return -1;
}

static const char *parse_error(bench *b, cw_error *out, int type, const char *p)
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
        fail(b, "script: bad place %s", place);
    if (find_word(roles, role) < 0 || find_word(flags, flag) < 0)
        fail(b, "script: bad error %s %s", role, flag);
    out->role = (cw_role)find_word(roles, role);
    out->flag = (cw_flag)find_word(flags, flag);
    return p;
}

static void parse_counter(bench *b, expect *e, const char *word)
{
    int change = atoi(word + 1);

    if (word[1] == '=')
        e->zero = true;
    else if (word[0] == 'T')
        e->tec_change += change;
    else if (word[0] == 'R')
        e->rec_change += change;
    else
        fail(b, "script: bad word %s", word);
}

/* Reads what stands in brackets at p, if anything, into *e. Returns where it ends. */
static const char *parse_expect(bench *b, expect *e, const char *p)
{
    static const char *const types[] = {"bit", "stuff", "form", "crc", "ack", NULL};
    static const char *const events[] = {"start", "lost", "",     "ovl",  "rx",
                                         "tx",    "",     "drop", "tol", NULL};
    char word[WORD_MAX];

    if (*p != '(')
        return p;
    for (p = next_word(word, p + 1); word[0]; p = next_word(word, p)) {
        if (find_word(types, word) >= 0) {
            e->what |= CW_REPORT_ERROR;
            p = parse_error(b, &e->error, find_word(types, word), p);
        } else if (find_word(events, word) >= 0) {
            e->what |= (uint16_t)(1u << find_word(events, word));
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

static void offer(bench *b, const cw_frame *frame)
{
    if (cw_mac_offer(&b->mac, frame) != CW_OK)
        fail(b, "the offer was refused");
    b->pending = true;
}

static int rec_change_of_success(unsigned rec)
{
    if (rec >= PASSIVE_LIMIT)
        return (int)REC_AFTER_PASSIVE - (int)rec;
    return rec > 0 ? -1 : 0;
}

static bool acknowledges(const bench *b)
{
    return b->sender == BY_BENCH && !b->wire.crc_wrong;
}

/* What happens by itself in bit n of the present frame when nothing disturbs it. */
static expect expect_of(const bench *b, unsigned n)
{
    const wire_bit *bit = &b->wire.bit[n];
    bool listening = (b->modes & CW_MODE_LISTEN_ONLY) != 0;
    expect e = {.place = bit->place};

    e.check_place = b->sender != BY_NOBODY_KNOWN && !b->wire.no_sof &&
                    (n > 0 || b->sender == BY_NODE);
    if (b->sender == BY_NODE && n == 0)
        e.what = CW_REPORT_STARTED;
    if (b->sender == BY_NODE && n + 1 == b->wire.length) {
        e.what = CW_REPORT_TX;
        e.tec_change = b->tec > 0 ? -1 : 0;
    }
    if (acknowledges(b) && n == b->wire.ack && !listening)
        e.rec_change = rec_change_of_success(b->rec);
    if (acknowledges(b) && n + 2 == b->wire.length)
        e.what = CW_REPORT_RX;
    return e;
}

/* The node's own level in bit n of the present frame. */
static bool own_level(const bench *b, unsigned n)
{
    if (b->sender == BY_NODE)
        return b->wire.bit[n].level;
    return !(acknowledges(b) && n == b->wire.ack && !(b->modes & CW_MODE_LISTEN_ONLY));
}

static bool bench_level(const bench *b, unsigned n)
{
    if (b->sender == BY_NODE)
        return n != b->wire.ack;
    return b->sender == BY_NOBODY_KNOWN && n == b->wire.ack ? false : b->wire.bit[n].level;
}

static void play_wire(bench *b, unsigned to, bool joins)
{
    for (; b->next < to && !b->why[0]; b->next++) {
        expect e = expect_of(b, b->next);
        if (joins)
            e.what |= CW_REPORT_STARTED;
        bit(b, bench_level(b, b->next), own_level(b, b->next), false, e);
        joins = false;
    }
}

static const char *parse_range(bench *b, unsigned *from, unsigned *to, const char *p)
{
    const char *end = p;
    int at;

    *from = 0;
    *to = b->wire.length;
    for (; *p == '@' || *p == ':'; p = end) {
        at = wire_find(&b->wire, p + 1, &end);
        if (at < 0) {
            fail(b, "script: the frame has no bit %.*s", TOKEN_SHOWN, p + 1);
            return p + strcspn(p, " ");
        }
        *(*p == '@' ? from : to) = (unsigned)at;
    }
    return p;
}

static const char *play_frame(bench *b, const char *p)
{
    char kind = *p;
    unsigned from, to;
    const char *end = wire_parse(&b->wire, p + 1);

    if (!end) {
        fail(b, "script: malformed frame, or the encoders disagree");
        return p + strcspn(p, " ");
    }
    end = parse_range(b, &from, &to, end);
    b->sender = kind == '>' ? BY_NODE : kind == '<' ? BY_BENCH : BY_NOBODY_KNOWN;
    b->next = from;
    if (kind == '>' && !b->pending)
        offer(b, &b->wire.frame);
    play_wire(b, to, kind == '>' && b->wire.bit[from].place.field == CW_FIELD_ID &&
                         b->wire.bit[from].place.index == 0);
    return end;
}

/* Both send; the node goes on with the bench's frame from the bit after the one it lost. */
static void play_contest(bench *b, const wire *bench_wire, unsigned from, unsigned to)
{
    unsigned lost = from;
    expect e;

    while (b->wire.bit[lost].level == bench_wire->bit[lost].level)
        lost++;
    if (!b->wire.bit[lost].level || !b->wire.bit[lost].arbitration ||
        b->wire.bit[lost].place.stuff) {
        fail(b, "script: the node does not lose arbitration");
        return;
    }
    play_wire(b, lost, from > 0);
    e = expect_of(b, lost);
    e.what |= CW_REPORT_ARBITRATION_LOST;
    if (from > 0 && lost == from) /* joined and lost in one bit */
        e.what |= CW_REPORT_STARTED;
    if (b->modes & CW_MODE_ONE_SHOT)
        e.what |= CW_REPORT_DROPPED;
    e.lost_bit = wire_lost_bit(&b->wire, lost);
    bit(b, false, true, false, e);
    b->wire = *bench_wire;
    b->sender = BY_BENCH;
    b->next = lost + 1;
    play_wire(b, to, false);
}

static const char *play_contest_token(bench *b, const char *p)
{
    wire own, bench_wire;
    unsigned from, to;
    const char *end = wire_parse(&own, p + 1);

    if (!end || *end != '/' || !(end = wire_parse(&bench_wire, end + 1))) {
        fail(b, "script: malformed frames");
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

static const char *play_inverted(bench *b, const char *p)
{
    bool level = b->wire.bit[b->next].level;
    bool own = own_level(b, b->next);
    expect e = {0};

    if (b->sender == BY_NODE && b->next == 0)
        e.what = CW_REPORT_STARTED;
    p = parse_expect(b, &e, p + 1);
    bit(b, !level, own, !own, e);
    b->next++;
    return p;
}

/* ---- Single bits and commands ---------------------------------------------------------------- */

static const char *play_bits(bench *b, const char *p)
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
        bit(b, kind != 'd' && kind != 'B', kind == 'r' || kind == 'd', kind == 'X',
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
        modes |= *p == 'A' ? CW_MODE_PRESUME_ACK : 0;
    }
    return modes;
}

static void do_init(bench *b, const char *p)
{
    b->modes = parse_modes(p);
    cw_mac_init(&b->mac, b->modes, WARNING_LIMIT);
}

static void do_modes(bench *b, const char *p)
{
    b->modes = parse_modes(p);
    cw_mac_set_modes(&b->mac, b->modes);
}

static void do_set(bench *b, const char *p)
{
    char *end;

    b->tec = (unsigned)strtoul(p, &end, 10);
    b->rec = (unsigned)strtoul(end + 1, NULL, 10);
    if (cw_mac_set_counters(&b->mac, b->tec, b->rec) != CW_OK)
        fail(b, "the counters cannot be preset");
}

static void do_offer(bench *b, const char *p)
{
    wire w;

    if (wire_parse(&w, p))
        offer(b, &w.frame);
    else
        fail(b, "script: malformed frame");
}

static void do_refuse(bench *b, const char *p)
{
    wire w;

    if (!wire_parse(&w, p) || cw_mac_offer(&b->mac, &w.frame) != CW_REFUSED)
        fail(b, "the offer was not refused");
}

static void do_withdraw(bench *b, const char *p)
{
    (void)p;
    if (cw_mac_withdraw(&b->mac) != CW_OK)
        fail(b, "the frame cannot be withdrawn");
    b->pending = false;
}

static void do_restart(bench *b, const char *p)
{
    (void)p;
    if (cw_mac_request_restart(&b->mac) != CW_OK)
        fail(b, "the restart was refused");
}

static void do_no_restart(bench *b, const char *p)
{
    (void)p;
    if (cw_mac_request_restart(&b->mac) != CW_REFUSED)
        fail(b, "the restart was not refused");
}

static void do_overload(bench *b, const char *p)
{
    if (cw_mac_request_overload(&b->mac, (unsigned)atoi(p)) != CW_OK)
        fail(b, "the overload frames were refused");
}

static void do_away(bench *b, const char *p)
{
    (void)p;
    b->away = true;
}

static const struct {
    const char *word;
    void (*run)(bench *b, const char *argument);
} commands[] = {
    {"set=", do_set},         {"offer=", do_offer},     {"refuse=", do_refuse},
    {"withdraw", do_withdraw}, {"restart", do_restart}, {"overload=", do_overload},
    {"modes=", do_modes},     {"init=", do_init},       {"away", do_away},
    {"no-restart", do_no_restart},
};

static const char *play_command(bench *b, const char *p)
{
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        size_t length = strlen(commands[i].word);
        if (strncmp(commands[i].word, p, length) == 0) {
            commands[i].run(b, p + length);
            return p + strcspn(p, " ");
        }
    }
    fail(b, "script: unknown token");
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

static const char *play_repeated(bench *b, const char *p, const char *end)
{
    char *open;
    unsigned n = (unsigned)strtoul(p, &open, 10);
    const char *close = *open == '[' ? matching_bracket(open, end) : NULL;

    if (!close) {
        fail(b, "script: no brackets after the number");
        return end;
    }
    for (unsigned i = 0; i < n && !b->why[0]; i++)
        play(b, open + 1, close);
    return close + 1;
}

static const char *play_token(bench *b, const char *p, const char *end)
{
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

static const char *play(bench *b, const char *p, const char *end)
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

static void play_all(bench *b, const char *text)
{
    play(b, text, text + strlen(text));
}

static void run_one(const char *script)
{
    static bench b;

    b = (bench){0};
    for (unsigned i = 0; i < 3; i++)
        memset(b.history[i], ' ', HISTORY);
    run.elementary++;
    if (run.verbose)
        printf("%s.%u: %s\n", run.number, run.elementary, script);
    do_init(&b, "");
    b.token = script;
    if (strncmp(script, "init=", 5) != 0)
        play_all(&b, INTEGRATION);
    play_all(&b, script);
    if (!b.away && !b.why[0])
        play_all(&b, CLOSING);
    ++*(b.why[0] ? run.failed : run.passed);
    if (b.why[0])
        report_failure(&b, script);
}
