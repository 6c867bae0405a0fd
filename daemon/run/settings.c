/* SPDX-License-Identifier: MIT
 *
 * settings.c - the settings of a node that can change while the bus runs, as JSON.
 */
#include "run/settings.h"

#include "base/text/chars.h"
#include "base/text/jsonput.h"
#include "base/text/nearest.h"
#include "base/text/number.h"
#include "config/change/live.h"
#include "config/values.h"
#include "config/node/wake.h"

#include <inttypes.h>
#include <string.h>

/* ---- From JSON ------------------------------------------------------------------------------- */

/* Reads true, false, or a text that the configuration accepts. */
static bool read_bool(bool *out, const json_t *value)
{
    const char *text = json_string_value(value);
    *out = json_is_true(value);
    return json_is_boolean(value) || (text && schema_parse_bool(out, text));
}

/* Reads a number, or a text that is one. */
static bool settings_read_number(uint64_t *out, const json_t *value)
{
    if (json_is_integer(value) && json_integer_value(value) >= 0) {
        *out = (uint64_t)json_integer_value(value);
        return true;
    }
    const char *text = json_string_value(value);
    return text && !text_parse_uint(out, text);
}

/* Sets or clears a mode. Modes that are not named stay as they are. */
static bool set_mode(cw_settings *s, char *error, const schema_key *key, const json_t *value)
{
    const uint8_t mode = (uint8_t)cfg_live_of(key)->which;
    bool on = false;
    if (!read_bool(&on, value)) {
        snprintf(error, SETTINGS_ERROR_MAX, "%s: expected on or off", key->name);
        return false;
    }
    s->which |= CW_SET_MODES;
    s->modes_mask |= mode;
    if (on)
        s->modes |= mode;
    return true;
}

/* Sets a number, in the range of its row. */
static bool set_number(cw_settings *s, char *error, const schema_key *key, const json_t *value)
{
    const schema_range *range = key->arg;
    uint64_t number = 0;
    if (!settings_read_number(&number, value) || number < range->min || number > range->max) {
        const char *text = json_string_value(value);
        const size_t used = chars_print(error, SETTINGS_ERROR_MAX, 0,
                                        "%s: expected a number from %" PRIu64 " to %" PRIu64,
                                        key->name, range->min, range->max);
        if (text && text_meant_uint(&number, text) && number >= range->min && number <= range->max)
            (void)chars_print(error, SETTINGS_ERROR_MAX, used, ", write %" PRIu64, number);
        return false;
    }
    cfg_put_number(s, key, number);
    return true;
}

/* Sets the order in which waiting frames go. */
static bool set_order(cw_settings *s, char *error, const schema_key *key, const json_t *value)
{
    const char *text = json_string_value(value);
    for (const schema_choice *order = key->arg; text && order->name; order++) {
        if (strcmp(order->name, text) == 0) {
            s->which |= CW_SET_ORDER;
            s->order = (cw_order)order->value;
            return true;
        }
    }
    snprintf(error, SETTINGS_ERROR_MAX, "%s: expected priority or fifo", key->name);
    return false;
}

/* Says why a key cannot be set: it needs a reload, is spelled wrong, or does not exist. Returns
 * false. */
static bool refuse_key(char *error, const char *name)
{
    nearest guess = {.word = name};
    size_t used = 0;
    for (const schema_key *key = cfg_node_keys; key->name; key++) {
        if (cfg_is_live(key))
            nearest_consider(&guess, key->name);
    }
    const schema_key *found = cfg_find_node_key(name);
    if (found && found->live) {
        snprintf(error, SETTINGS_ERROR_MAX, "%s: change it in the configuration and reload", name);
        return false;
    }
    if (guess.best) {
        snprintf(error, SETTINGS_ERROR_MAX, "there is no setting '%.40s' (did you mean '%s'?)",
                 name, guess.best);
        return false;
    }
    used = chars_print(error, SETTINGS_ERROR_MAX, 0, "there is no setting '%.40s'; there are",
                       name);
    const char *between = " ";
    for (const schema_key *key = cfg_node_keys; key->name; key++) {
        if (!cfg_is_live(key))
            continue;
        used = chars_print(error, SETTINGS_ERROR_MAX, used, "%s%s", between, key->name);
        between = ", ";
    }
    return false;
}

/* Returns a text, a number or a truth value as it stands in a configuration; "" for others. */
static const char *as_text(char room[TIME_TEXT_MAX], const json_t *value)
{
    room[0] = '\0';
    if (json_is_boolean(value))
        return json_is_true(value) ? "on" : "off";
    if (json_is_integer(value))
        (void)snprintf(room, TIME_TEXT_MAX, "%" JSON_INTEGER_FORMAT, json_integer_value(value));
    else if (json_is_real(value))
        (void)snprintf(room, TIME_TEXT_MAX, "%g", json_real_value(value));
    return json_is_string(value) ? json_string_value(value) : room;
}

/* Sets a key of time, which is put into effect with all others of its request. */
static bool set_time(cfg_retime *time, char *error, const schema_key *key, const json_t *value)
{
    char room[TIME_TEXT_MAX], problem[RETIME_PROBLEM_MAX];
    if (cfg_retime_put(time, problem, key, as_text(room, value)))
        return true;
    (void)snprintf(error, SETTINGS_ERROR_MAX, "%s", problem);
    return false;
}

/* Sends the node to sleep, or wakes it. */
static bool set_sleep(cw_settings *s, char *error, const schema_key *key, const json_t *value)
{
    if (!read_bool(&s->sleeps, value)) {
        snprintf(error, SETTINGS_ERROR_MAX, "%s: expected on or off", key->name);
        return false;
    }
    s->which |= CW_SET_SLEEP;
    return true;
}

/* Sets what wakes the node. */
static bool set_wake(cw_settings *s, char *error, const schema_key *key, const json_t *value)
{
    char room[TIME_TEXT_MAX];
    const char *problem = cfg_wake_parse(&s->sleep, key, as_text(room, value));
    if (problem)
        snprintf(error, SETTINGS_ERROR_MAX, "%s: %s", key->name, problem);
    s->which |= cfg_live_of(key)->which;
    return !problem;
}

typedef bool key_setter(cw_settings *s, char *error, const schema_key *key, const json_t *value);

/* Sets the key of that name, by the kind of its row. */
static bool set_key(cw_settings *s, cfg_retime *time, char *error, const char *name,
                    const json_t *value)
{
    static key_setter *const setters[] = {
        [CFG_LIVE_MODE] = set_mode,       [CFG_LIVE_NUMBER] = set_number,
        [CFG_LIVE_ORDER] = set_order,     [CFG_LIVE_SLEEP] = set_sleep,
        [CFG_LIVE_WAKE_TIME] = set_wake, [CFG_LIVE_WAKE_ON] = set_wake,
    };
    const schema_key *key = cfg_find_node_key(name);
    if (!key || !cfg_is_live(key))
        return refuse_key(error, name);
    return cfg_is_retime(key) ? set_time(time, error, key, value)
                              : setters[cfg_live_of(key)->kind](s, error, key, value);
}

bool settings_from_json(cw_settings *out, cfg_retime *time, char error[SETTINGS_ERROR_MAX],
                        const json_t *object)
{
    cw_settings read = {.which = 0};
    cfg_retime of_time = {.given = 0};
    json_t *members = (json_t *)(uintptr_t)object; /* the iterator does not accept a const object */
    for (void *i = json_object_iter(members); i; i = json_object_iter_next(members, i))
        if (!set_key(&read, &of_time, error, json_object_iter_key(i), json_object_iter_value(i)))
            return false;
    if (read.which == 0 && of_time.given == 0) {
        snprintf(error, SETTINGS_ERROR_MAX, "no settings are given");
        return false;
    }
    *out = read;
    *time = of_time;
    return true;
}

/* ---- To JSON --------------------------------------------------------------------------------- */

/* Returns true when settings have a key. */
static bool has_key(const cw_settings *s, const cfg_retime *time, const cfg_live *live)
{
    if (live->kind >= CFG_LIVE_CLOCK)
        return time && time->given & RETIME_BIT(live->time);
    if (live->kind == CFG_LIVE_MODE)
        return s->which & CW_SET_MODES && s->modes_mask & live->which;
    return s->which & live->which;
}

static void put_wake(json_t *object, const schema_key *key, const cw_settings *s)
{
    char text[WAKE_TEXT_MAX];
    cfg_wake_print(text, &s->sleep, key);
    put_text(object, key->name, text);
}

static void put_retime(json_t *object, const schema_key *key, const cfg_retime *time)
{
    char text[TIME_TEXT_MAX];
    cfg_retime_print(text, time, key);
    put_text(object, key->name, text);
}

/* Puts the present value of a key into an object. */
static void put_key(json_t *object, const schema_key *key, const cw_settings *s,
                    const cfg_retime *time)
{
    const cfg_live *live = cfg_live_of(key);
    if (live->kind == CFG_LIVE_MODE)
        put_bool(object, key->name, s->modes & live->which);
    else if (live->kind == CFG_LIVE_NUMBER)
        put_count(object, key->name, cfg_get_number(s, key));
    else if (live->kind == CFG_LIVE_ORDER)
        put_text(object, key->name, cfg_orders[s->order].name);
    else if (live->kind == CFG_LIVE_SLEEP)
        put_bool(object, key->name, s->sleeps);
    else if (cfg_is_retime(key))
        put_retime(object, key, time);
    else
        put_wake(object, key, s);
}

json_t *settings_given_to_json(const cw_settings *settings, const cfg_retime *time)
{
    json_t *object = json_object();
    for (const schema_key *key = cfg_node_keys; key->name; key++)
        if (cfg_is_live(key) && has_key(settings, time, cfg_live_of(key)))
            put_key(object, key, settings, time);
    return object;
}

json_t *settings_to_json(const cw_settings *settings)
{
    cw_settings all = *settings;
    all.which = UINT8_MAX | CW_SET_SLEEP | CW_SET_WAKE;
    all.modes_mask = UINT8_MAX;
    return settings_given_to_json(&all, NULL);
}
