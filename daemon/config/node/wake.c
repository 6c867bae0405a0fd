/* SPDX-License-Identifier: MIT
 *
 * wake.c - the keys about what wakes a sleeping node.
 */
#include "config/node/wake.h"

#include "base/text/number.h"
#include "config/change/live.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <string.h>

/* Returns the time of a key. */
static uint64_t *time_of(cw_sleep_settings *settings, const schema_key *key)
{
    const size_t offset = cfg_live_of(key)->offset - offsetof(cw_settings, sleep);

    return (uint64_t *)(void *)((char *)settings + offset);
}

static bool is_time(const schema_key *key)
{
    return cfg_live_of(key)->kind == CFG_LIVE_WAKE_TIME;
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

/* Takes filters with commas between them, or `off` for none. All are replaced. */
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

const char *cfg_wake_parse(cw_sleep_settings *out, const schema_key *key, const char *text)
{
    return is_time(key) ? parse_time(time_of(out, key), text) : parse_frames(out, text);
}

/* Prints filters as parse_frames() takes them. */
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

void cfg_wake_print(char out[WAKE_TEXT_MAX], const cw_sleep_settings *settings,
                    const schema_key *key)
{
    cw_sleep_settings copy = *settings;

    if (is_time(key))
        text_print_span(out, *time_of(&copy, key));
    else
        print_frames(out, settings);
}

/* Reads a list of filters, each of which may be several. */
void cfg_wake_read_into(schema *self, const schema_key *key, yaml_node_t *value,
                        cw_sleep_settings *out)
{
    if (!is_time(key) && value->type == YAML_SEQUENCE_NODE) {
        out->frame_count = (uint8_t)cfg_read_filter_list(self, key, value, out->frames, 0,
                                                         CW_WAKE_FILTERS_MAX);
        return;
    }
    const char *text = schema_text(self, key, value, is_time(key)
                                                         ? "a time from 0 to 1s, such as 5us"
                                                         : "a frame filter such as 123, or off");
    if (text)
        schema_problem(self, key, value, cfg_wake_parse(out, key, text));
}
