/* SPDX-License-Identifier: MIT
 *
 * settings.c - the settings of a node that can change while the bus runs, as JSON.
 */
#include "run/settings.h"

#include "base/jsonput.h"
#include "base/nearest.h"
#include "base/number.h"
#include "config/wake.h"

#include <inttypes.h>
#include <string.h>

#define TICKS_PER_MS (CW_CLOCK_HZ / 1000u)

typedef struct mode_key {
    const char *name;
    uint8_t mode;
} mode_key;

/* A key with a number; put_number() puts it into the settings. */
typedef struct number_key {
    const char *name;
    uint16_t which; /* CW_SET_* */
    uint64_t min;
    uint64_t max;
} number_key;

/* The modes in the order of `ip`. */
static const mode_key mode_keys[] = {
    {"loopback", CW_MODE_LOOPBACK},       {"listen-only", CW_MODE_LISTEN_ONLY},
    {"one-shot", CW_MODE_ONE_SHOT},       {"berr-reporting", CW_MODE_BERR_REPORTING},
    {"presume-ack", CW_MODE_PRESUME_ACK}, {"restricted", CW_MODE_RESTRICTED},
    {"time-triggered", CW_MODE_TIME_TRIGGERED},
    {"lost-arbitration-reporting", CW_MODE_LOST_ARBITRATION_REPORTING},
};

static const number_key number_keys[] = {
    {"restart-ms", CW_SET_RESTART, 0, UINT32_MAX},
    {"queue", CW_SET_QUEUE, 1, CW_QUEUE_MAX},
    {"warning-limit", CW_SET_WARNING, 1, 255},
};

static const char order_key[] = "order";
static const char sleep_key[] = "sleep";
static const char *const order_names[] = {
    [CW_ORDER_PRIORITY] = "priority",
    [CW_ORDER_FIFO] = "fifo",
};

/* Keys of a node that the bus knows from its begin. */
static const char *const fixed_keys[] = {
    "when-full", "controller", "filter", "kind", "fd", "protocol-exception",
};

#define COUNT_OF(array) (sizeof(array) / sizeof((array)[0]))

static const mode_key *find_mode(const char *key)
{
    for (size_t i = 0; i < COUNT_OF(mode_keys); i++)
        if (strcmp(mode_keys[i].name, key) == 0)
            return &mode_keys[i];
    return NULL;
}

static const number_key *find_number(const char *key)
{
    for (size_t i = 0; i < COUNT_OF(number_keys); i++)
        if (strcmp(number_keys[i].name, key) == 0)
            return &number_keys[i];
    return NULL;
}

/* ---- From JSON ------------------------------------------------------------------------------- */

/* Reads true, false, or a text that the configuration accepts. */
static bool read_bool(bool *out, const json_t *value)
{
    static const char *const words[2][3] = {{"off", "no", "false"}, {"on", "yes", "true"}};
    if (json_is_boolean(value)) {
        *out = json_is_true(value);
        return true;
    }
    const char *text = json_string_value(value);
    for (size_t i = 0; text && i < 6; i++) {
        if (strcmp(words[i / 3][i % 3], text) == 0) {
            *out = i / 3 == 1;
            return true;
        }
    }
    return false;
}

static bool read_number(uint64_t *out, const json_t *value)
{
    if (json_is_integer(value) && json_integer_value(value) >= 0) {
        *out = (uint64_t)json_integer_value(value);
        return true;
    }
    const char *text = json_string_value(value);
    return text && !text_parse_uint(out, text);
}

static bool set_mode(cw_settings *s, char *error, const mode_key *key, const json_t *value)
{
    bool on = false;
    if (!read_bool(&on, value)) {
        snprintf(error, SETTINGS_ERROR_MAX, "%s: expected on or off", key->name);
        return false;
    }
    s->which |= CW_SET_MODES;
    s->modes_mask |= key->mode;
    if (on)
        s->modes |= key->mode;
    return true;
}

static void put_number(cw_settings *s, uint16_t which, uint64_t number)
{
    s->which |= which;
    if (which == CW_SET_RESTART)
        s->restart_ticks = number * TICKS_PER_MS;
    else if (which == CW_SET_QUEUE)
        s->queue = (uint16_t)number;
    else
        s->warning_limit = (uint16_t)number;
}

static bool set_number(cw_settings *s, char *error, const number_key *key, const json_t *value)
{
    uint64_t number = 0;
    if (!read_number(&number, value) || number < key->min || number > key->max) {
        const char *text = json_string_value(value);
        int used = snprintf(error, SETTINGS_ERROR_MAX,
                            "%s: expected a number from %" PRIu64 " to %" PRIu64, key->name,
                            key->min, key->max);
        if (text && text_meant_uint(&number, text) && number >= key->min && number <= key->max)
            snprintf(error + used, SETTINGS_ERROR_MAX - (size_t)used, ", write %" PRIu64, number);
        return false;
    }
    put_number(s, key->which, number);
    return true;
}

static bool set_order(cw_settings *s, char *error, const json_t *value)
{
    const char *text = json_string_value(value);
    for (unsigned i = 0; text && i < COUNT_OF(order_names); i++) {
        if (strcmp(order_names[i], text) == 0) {
            s->which |= CW_SET_ORDER;
            s->order = (cw_order)i;
            return true;
        }
    }
    snprintf(error, SETTINGS_ERROR_MAX, "order: expected priority or fifo");
    return false;
}

static bool refuse_key(char *error, const char *key)
{
    nearest guess = {.word = key};
    for (size_t i = 0; i < COUNT_OF(fixed_keys); i++)
        if (strcmp(fixed_keys[i], key) == 0) {
            snprintf(error, SETTINGS_ERROR_MAX, "%s: change it in the configuration and reload",
                     key);
            return false;
        }
    for (size_t i = 0; i < COUNT_OF(mode_keys); i++)
        nearest_consider(&guess, mode_keys[i].name);
    for (size_t i = 0; i < COUNT_OF(number_keys); i++)
        nearest_consider(&guess, number_keys[i].name);
    for (retime_key i = 0; i < RETIME_KEYS; i++)
        nearest_consider(&guess, cfg_retime_name(i));
    for (cfg_wake_key i = 0; i < CFG_WAKE_KEYS; i++)
        nearest_consider(&guess, cfg_wake_name(i));
    nearest_consider(&guess, order_key);
    nearest_consider(&guess, sleep_key);
    if (guess.best)
        snprintf(error, SETTINGS_ERROR_MAX, "there is no setting '%.40s' (did you mean '%s'?)", key,
                 guess.best);
    else
        snprintf(error, SETTINGS_ERROR_MAX,
                 "there is no setting '%.40s'; there are loopback, listen-only, one-shot, "
                 "berr-reporting, presume-ack, restricted, time-triggered, "
                 "lost-arbitration-reporting, "
                 "restart-ms, queue, order, warning-limit, sleep, wake-filter, "
                 "wake-time, wake-on, clock, ppm, sample-point, brp, "
                 "prop-seg, phase-seg1, phase-seg2, sjw, triple-sampling, dbrp, dprop-seg, "
                 "dphase-seg1, dphase-seg2, dsjw, dsample-point, tdc-mode, tdco, tdcv, tx-delay, "
                 "rx-delay, position, stub, ringing",
                 key);
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

static bool set_time(cfg_retime *time, char *error, retime_key key, const json_t *value)
{
    char room[TIME_TEXT_MAX], problem[RETIME_PROBLEM_MAX];
    if (cfg_retime_put(time, problem, key, as_text(room, value)))
        return true;
    (void)snprintf(error, SETTINGS_ERROR_MAX, "%s", problem);
    return false;
}

static bool set_sleep(cw_settings *s, char *error, const json_t *value)
{
    if (!read_bool(&s->sleeps, value)) {
        snprintf(error, SETTINGS_ERROR_MAX, "sleep: expected on or off");
        return false;
    }
    s->which |= CW_SET_SLEEP;
    return true;
}

static bool set_wake(cw_settings *s, char *error, cfg_wake_key key, const json_t *value)
{
    char room[TIME_TEXT_MAX];
    const char *problem = cfg_wake_parse(&s->sleep, key, as_text(room, value));
    if (problem)
        snprintf(error, SETTINGS_ERROR_MAX, "%s: %s", cfg_wake_name(key), problem);
    s->which |= cfg_wake_set(key);
    return !problem;
}

static bool set_key(cw_settings *s, cfg_retime *time, char *error, const char *key,
                    const json_t *value)
{
    const mode_key *mode = find_mode(key);
    const number_key *number = find_number(key);
    const retime_key of_time = cfg_retime_find(key);
    const cfg_wake_key wake = cfg_wake_find(key);
    if (mode)
        return set_mode(s, error, mode, value);
    if (number)
        return set_number(s, error, number, value);
    if (of_time != RETIME_KEYS)
        return set_time(time, error, of_time, value);
    if (wake != CFG_WAKE_KEYS)
        return set_wake(s, error, wake, value);
    if (strcmp(key, sleep_key) == 0)
        return set_sleep(s, error, value);
    if (strcmp(key, order_key) == 0)
        return set_order(s, error, value);
    return refuse_key(error, key);
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

static void put_time(json_t *object, const cfg_retime *time)
{
    for (retime_key key = 0; time && key < RETIME_KEYS; key++) {
        char text[TIME_TEXT_MAX];
        if (time->given >> key & 1u) {
            cfg_retime_print(text, time, key);
            put_text(object, cfg_retime_name(key), text);
        }
    }
}

static void put_sleep(json_t *object, const cw_settings *s)
{
    if (s->which & CW_SET_SLEEP)
        put_bool(object, sleep_key, s->sleeps);
    for (cfg_wake_key key = 0; key < CFG_WAKE_KEYS; key++) {
        char text[WAKE_TEXT_MAX];
        if (!(s->which & cfg_wake_set(key)))
            continue;
        cfg_wake_print(text, &s->sleep, key);
        put_text(object, cfg_wake_name(key), text);
    }
}

json_t *settings_given_to_json(const cw_settings *settings, const cfg_retime *time)
{
    json_t *object = json_object();
    uint8_t modes = settings->which & CW_SET_MODES ? settings->modes_mask : 0;
    for (size_t i = 0; i < COUNT_OF(mode_keys); i++)
        if (modes & mode_keys[i].mode)
            put_bool(object, mode_keys[i].name, settings->modes & mode_keys[i].mode);
    if (settings->which & CW_SET_RESTART)
        put_count(object, "restart-ms", settings->restart_ticks / TICKS_PER_MS);
    if (settings->which & CW_SET_QUEUE)
        put_count(object, "queue", settings->queue);
    if (settings->which & CW_SET_ORDER)
        put_text(object, order_key, order_names[settings->order]);
    if (settings->which & CW_SET_WARNING)
        put_count(object, "warning-limit", settings->warning_limit);
    put_sleep(object, settings);
    put_time(object, time);
    return object;
}

json_t *settings_to_json(const cw_settings *settings)
{
    cw_settings all = *settings;
    all.which = UINT8_MAX | CW_SET_SLEEP | CW_SET_WAKE;
    all.modes_mask = UINT8_MAX;
    return settings_given_to_json(&all, NULL);
}
