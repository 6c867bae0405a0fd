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
