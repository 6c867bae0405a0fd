/* SPDX-License-Identifier: MIT
 *
 * retime_values.c - values of keys of a node's bit timing and of its place, as texts.
 */
#include "config/change/retime.h"

#include "config/change/live.h"

#include <inttypes.h>
#include <stdarg.h>
#include <string.h>

#define CLOCK_MIN_HZ 100000u
#define CLOCK_MAX_HZ 1000000000u
#define PPM_MAX 100000u

bool cfg_refuse(char problem[RETIME_PROBLEM_MAX], const char *format, ...)
{
    va_list args;
    va_start(args, format);
    (void)vsnprintf(problem, RETIME_PROBLEM_MAX, format, args);
    va_end(args);
    return false;
}

bool cfg_clock_valid(uint64_t hz)
{
    return hz >= CLOCK_MIN_HZ && hz <= CLOCK_MAX_HZ;
}

bool cfg_parse_ppm(int32_t *ppm, const char *text)
{
    const bool negative = *text == '-';
    uint64_t size;
    if (text_parse_uint(&size, text + negative) || size > PPM_MAX)
        return false;
    *ppm = negative ? -(int32_t)size : (int32_t)size;
    return true;
}

/* Says what a key takes. */
static bool refuse_text(char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                        const char *expected, const char *text)
{
    return cfg_refuse(problem, "%s: expected %s, not '%.40s'", key->name, expected, text);
}

/* Each puts the value of a key into its member. A wrong one returns false, after a message. */
typedef bool value_putter(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                          const char *text);

/* Takes the frequency of a controller's clock, in Hz. */
static bool put_clock(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                      const char *text)
{
    uint64_t hz;
    const char *wrong = text_parse_frequency(&hz, text);
    if (wrong)
        return cfg_refuse(problem, "%s: '%.40s': %s", key->name, text, wrong);
    if (!cfg_clock_valid(hz))
        return refuse_text(problem, key, CFG_CLOCK_RANGE, text);
    *(uint32_t *)member = (uint32_t)hz;
    return true;
}

static bool put_ppm(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                    const char *text)
{
    return cfg_parse_ppm(member, text) ||
           refuse_text(problem, key, CFG_PPM_RANGE, text);
}

static bool put_sample_point(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                             const char *text)
{
    const char *wrong = text_parse_sample_point(member, text);
    return !wrong || cfg_refuse(problem, "%s: '%.40s': %s", key->name, text, wrong);
}

/* Takes a number in the range of the key: clocks of a quantum, quanta of a segment, and the
 * like. */
static bool put_clocks(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                       const char *text)
{
    const schema_range *range = key->arg;
    uint64_t value;
    if (text_parse_uint(&value, text) || value < range->min || value > range->max)
        return cfg_refuse(problem, "%s: expected a decimal integer %" PRIu64 "..%" PRIu64
                      ", not '%.40s'", key->name, range->min, range->max, text);
    *(uint32_t *)member = (uint32_t)value;
    return true;
}

static bool put_switch(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                       const char *text)
{
    return schema_parse_bool(member, text) ||
           refuse_text(problem, key, "one of on, off, yes, no, true, false", text);
}

/* Takes a mode in the words of the configuration. */
static bool put_tdc_mode(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                         const char *text)
{
    for (const schema_choice *mode = key->arg; mode->name; mode++)
        if (strcmp(mode->name, text) == 0) {
            *(cfg_tdc *)member = (cfg_tdc)mode->value;
            return true;
        }
    return refuse_text(problem, key, "one of off, auto, manual", text);
}

static bool put_delays(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                       const char *text)
{
    return cfg_parse_delays(member, text) ||
           refuse_text(problem, key, CFG_DELAYS_RANGE, text);
}

static bool put_delay(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                      const char *text)
{
    return cfg_parse_delay(member, text) ||
           refuse_text(problem, key, CFG_DELAY_RANGE, text);
}

static bool put_length(void *member, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                       const char *text)
{
    return cfg_parse_way(member, text) ||
           refuse_text(problem, key, CFG_LENGTH_RANGE, text);
}

/* Each prints what one of the former reads. */
typedef void value_printer(char text[TIME_TEXT_MAX], const void *member, const schema_key *key);

static void print_clocks(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu32, *(const uint32_t *)member);
}

static void print_ppm(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    (void)snprintf(text, TIME_TEXT_MAX, "%" PRId32, *(const int32_t *)member);
}

static void print_sample_point(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    (void)snprintf(text, TIME_TEXT_MAX, "0.%03u", (unsigned)*(const uint16_t *)member);
}

static void print_switch(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    (void)snprintf(text, TIME_TEXT_MAX, "%s", *(const bool *)member ? "on" : "off");
}

/* Prints the mode in the words of the configuration. Each mode has one. */
static void print_tdc_mode(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    const schema_choice *mode = key->arg;
    while (mode->value != *(const cfg_tdc *)member)
        mode++;
    (void)snprintf(text, TIME_TEXT_MAX, "%s", mode->name);
}

static void print_delays(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    cfg_print_delays(text, member);
}

static void print_delay(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    cfg_print_delay(text, member);
}

static void print_length(char text[TIME_TEXT_MAX], const void *member, const schema_key *key)
{
    (void)key;
    (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu64 "mm", *(const uint64_t *)member);
}

static const struct {
    value_putter *put;
    value_printer *print;
} values_of[] = {
    [CFG_LIVE_CLOCK] = {put_clock, print_clocks},
    [CFG_LIVE_PPM] = {put_ppm, print_ppm},
    [CFG_LIVE_SAMPLE] = {put_sample_point, print_sample_point},
    [CFG_LIVE_CLOCKS] = {put_clocks, print_clocks},
    [CFG_LIVE_SWITCH] = {put_switch, print_switch},
    [CFG_LIVE_TDC] = {put_tdc_mode, print_tdc_mode},
    [CFG_LIVE_DELAYS] = {put_delays, print_delays},
    [CFG_LIVE_DELAY] = {put_delay, print_delay},
    [CFG_LIVE_LENGTH] = {put_length, print_length},
};

bool cfg_retime_put(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const schema_key *key,
                    const char *text)
{
    const cfg_live *live = cfg_live_of(key);
    if (!values_of[live->kind].put((char *)change + live->offset, problem, key, text))
        return false;
    change->given |= RETIME_BIT(live->time);
    return true;
}

void cfg_retime_print(char text[TIME_TEXT_MAX], const cfg_retime *values, const schema_key *key)
{
    const cfg_live *live = cfg_live_of(key);
    values_of[live->kind].print(text, (const char *)values + live->offset, key);
}
