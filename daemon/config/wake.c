/* SPDX-License-Identifier: MIT
 *
 * wake.c - the keys about what wakes a sleeping node.
 */
#include "config/wake.h"

#include "base/number.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <string.h>

static const char *const names[CFG_WAKE_KEYS] = {"wake-filter", "wake-time", "wake-on"};
static const unsigned sets[CFG_WAKE_KEYS] = {CW_SET_WAKE_FILTER, CW_SET_WAKE_TIME, CW_SET_WAKE_ON};

cfg_wake_key cfg_wake_find(const char *name)
{
    cfg_wake_key key = 0;

    while (key < CFG_WAKE_KEYS && strcmp(names[key], name) != 0)
        key++;
    return key;
}

const char *cfg_wake_name(cfg_wake_key key)
{
    return names[key];
}

unsigned cfg_wake_set(cfg_wake_key key)
{
    return sets[key];
}

/* A time of the transceiver knows no bits. */
static const char *parse_time(uint64_t *ticks, const char *text)
{
    cfg_time time = {0};
    const bool good = text_parse_time(&time, text) == NULL && time.bits == 0;
    const uint64_t found = text_time_ticks(time, cw_rate_of(1));

    if (!good || found > CW_WAKE_TICKS_MAX)
        return "expected a time from 0 to 1s, such as 5us";
    *ticks = found;
    return NULL;
}

static const char *parse_frames(cw_sleep_settings *out, const char *text)
{
    unsigned count = 0;
    const char *problem;

    if (strcmp(text, "off") == 0) {
        out->frame_count = 0;
        return NULL;
    }
    problem = text_parse_filters(out->frames, &count, CW_WAKE_FILTERS_MAX, text);
    if (!problem)
        out->frame_count = (uint8_t)count;
    return problem;
}

const char *cfg_wake_parse(cw_sleep_settings *out, cfg_wake_key key, const char *text)
{
    if (key == CFG_WAKE_FILTER)
        return parse_time(&out->filter_ticks, text);
    if (key == CFG_WAKE_TIME)
        return parse_time(&out->wake_ticks, text);
    return parse_frames(out, text);
}

static void print_frames(char out[WAKE_TEXT_MAX], const cw_sleep_settings *s)
{
    size_t length = 0;

    strcpy(out, "off");
    for (unsigned i = 0; i < s->frame_count; i++) {
        if (i > 0)
            out[length++] = ',';
        text_print_filter(out + length, &s->frames[i]);
        length += strlen(out + length);
    }
}

void cfg_wake_print(char out[WAKE_TEXT_MAX], const cw_sleep_settings *s, cfg_wake_key key)
{
    if (key == CFG_WAKE_FILTER)
        text_print_span(out, s->filter_ticks);
    else if (key == CFG_WAKE_TIME)
        text_print_span(out, s->wake_ticks);
    else
        print_frames(out, s);
}

/* Reads a list of filters, each of which may be several. */
void cfg_wake_read(schema *self, const schema_key *key, yaml_node_t *value,
                   cw_sleep_settings *out)
{
    const cfg_wake_key wake = cfg_wake_find(key->name);

    if (wake == CFG_WAKE_ON && value->type == YAML_SEQUENCE_NODE) {
        out->frame_count = (uint8_t)cfg_read_filter_list(self, key, value, out->frames, 0,
                                                         CW_WAKE_FILTERS_MAX);
        return;
    }
    const char *text = schema_text(self, key, value, wake == CFG_WAKE_ON
                                                         ? "a frame filter such as 123, or off"
                                                         : "a time from 0 to 1s, such as 5us");
    if (text)
        schema_problem(self, key, value, cfg_wake_parse(out, wake, text));
}
