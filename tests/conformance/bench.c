/* SPDX-License-Identifier: MIT
 *
 * bench.c - counts elementary tests and makes them from scripts with alternatives.
 */
#include "player.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define TOKEN_SHOWN 40
#define ALTERNATIVES_MAX 64

static struct {
    const char *number;
    unsigned *passed, *failed;
    unsigned elementary;
    bool verbose;
    uint32_t random;
    const pass *pass;
} run;

static void expand(const char *script);

void bench_begin(const char *number, unsigned *passed, unsigned *failed)
{
    run.number = number;
    run.passed = passed;
    run.failed = failed;
    run.elementary = 0;
    run.random = 0x2545F491;
}

void bench_set_pass(const pass *p)
{
    run.pass = p;
    wire_set_format(p->frames);
}

const pass *bench_pass_of(char letter)
{
    static const pass passes[] = {
        {'c', WIRE_CLASSICAL, CW_CLASSICAL}, {'t', WIRE_CLASSICAL, CW_FD_TOLERANT},
        {'n', WIRE_CLASSICAL, CW_FD},        {'f', WIRE_FD, CW_FD},
        {'l', WIRE_FD_LONG, CW_FD},          {'o', WIRE_FD_NON_ISO, CW_FD | CW_PROTOCOL_NON_ISO},
    };

    for (size_t i = 0; i < sizeof passes / sizeof passes[0]; i++) {
        if (passes[i].letter == letter)
            return &passes[i];
    }
    return NULL;
}

void bench_init_node(cw_mac *mac, cw_fd_part *part, unsigned modes)
{
    const unsigned protocol = run.pass->protocol;

    cw_mac_init(mac, modes, WARNING_LIMIT);
    const bool fd = (protocol & CW_PROTOCOL_MASK) == CW_FD;
    if (protocol != CW_CLASSICAL && cw_mac_set_protocol(mac, protocol, fd ? part : NULL) != CW_OK)
        bench_count("the protocol was refused");
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

const char *bench_in_pass(const char *script)
{
    const size_t letters = strspn(script, "ctnflo");

    if (letters == 0 || script[letters] != ':')
        return script;
    if (!memchr(script, run.pass->letter, letters))
        return NULL;
    return script + letters + 1 + strspn(script + letters + 1, " ");
}

void bench_run(const char *format, ...)
{
    char script[SCRIPT_MAX];
    const char *body;
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(script, sizeof script, format, arguments);
    va_end(arguments);
    body = bench_in_pass(script);
    if (body)
        expand(body);
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
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, wire_data_bytes(a)) == 0;
}

void bench_run_frames(char kind, bool extended)
{
    static const uint32_t ids[2][4] = {{0x555, 0x2AA, 0, 0x7FF},
                                       {0x15555555, 0x0AAAAAAA, 0, 0x1FFFFFFF}};
    const char *format = wire_format_text();
    const unsigned lengths = wire_is_fd() ? 16 : 9;

    for (unsigned n = 0; n < 5 * lengths; n++) {
        char data[2 * CW_FRAME_DATA_MAX + 1] = "";
        cw_frame frame = {.flags = CW_FRAME_FD, .dlc = (uint8_t)(n % lengths)};
        uint32_t id = n < 4 * lengths ? ids[extended][n / lengths]
                                      : bench_random() & ids[extended][3];
        for (unsigned i = 0; i < wire_data_bytes(&frame); i++)
            snprintf(data + 2 * i, 3, "%02X", bench_random() & 0xFF);
        bench_run("%c%0*X#%s%s r3", kind, extended ? 8 : 3, id, format, data);
    }
}

void bench_run_stuff_bits(const char *before, char kind, const char *frame,
                          const char *(*tail)(const wire_bit *bit))
{
    wire w;
    unsigned nth = 0;

    if (!wire_parse(&w, frame))
        bench_count("malformed frame");
    for (unsigned i = 0; i < w.length; i++) {
        if (w.bit[i].place.stuff && w.bit[i].place.field != CW_FIELD_FIXED_STUFF)
            bench_run("%s%c%s:st%u ~%s%c%s r3", before, kind, frame, nth++, tail(&w.bit[i]), kind,
                      frame);
    }
}

/* Finds a frame with this level of a fixed stuff bit. */
static bool find_fixed(char *frame, size_t size, unsigned bytes, const char *place, bool level)
{
    const char *end;
    wire w;

    for (unsigned byte = 0; byte < 256; byte++) {
        snprintf(frame, size, "123##%u%02Xx%u", byte % 2, byte, bytes);
        if (wire_parse(&w, frame) && w.bit[wire_find(&w, place, &end)].level == level)
            return true;
    }
    return false;
}

void bench_run_fixed_stuff_bits(const char *before, char kind, const char *tail)
{
    static const unsigned bytes[2] = {16, 20}, count[2] = {6, 7};
    char frame[32], place[NAME_MAX_LENGTH];

    for (unsigned k = 0; k < 2; k++) {
        for (unsigned n = 0; n < 2 * count[k]; n++) {
            snprintf(place, sizeof place, "fs%u", n / 2);
            if (find_fixed(frame, sizeof frame, bytes[k], place, n % 2 != 0))
                bench_run("%s%c%s:%s ~%s%c%s r3", before, kind, frame, place, tail, kind, frame);
        }
    }
}

/* ---- Elementary tests ------------------------------------------------------------------------ */

static void report_failure(const player *b, const char *script)
{
    printf("FAILED %s, elementary test %u, bit %u, at \"%.*s\": %s\n", run.number, run.elementary,
           b->bit, TOKEN_SHOWN, b->token, b->why);
    printf("    script: %s\n", script);
    printf("    bench %s\n    node  %s\n    bus   %s\n", b->history[0], b->history[1],
           b->history[2]);
}

static void run_one(const char *script)
{
    static player b;

    run.elementary++;
    if (run.verbose)
        printf("%s.%u: %s\n", run.number, run.elementary, script);
    player_init(&b, run.verbose);
    player_run(&b, script);
    ++*(b.why[0] ? run.failed : run.passed);
    if (b.why[0])
        report_failure(&b, script);
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
