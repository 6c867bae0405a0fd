/* SPDX-License-Identifier: MIT
 *
 * report.c - what an analysis has found, as a table and as JSON.
 */
#include "cli/analyse/report.h"

#include "base/text/jsonput.h"
#include "cli/analyse/failure.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <string.h>

#define CELL_MAX 40
#define PPM 1000000u
#define UNDETECTED 4.7e-11 /* of destroyed base frames */

/* ---- Values ---------------------------------------------------------------------------------- */

static bool exceeds(const source *s, const response_message *m)
{
    return m->response != CW_NEVER && s->seen > m->response;
}

/* Returns the releases of a message whose responses have an end in the simulation. */
static uint64_t due(const analysis *a, size_t i)
{
    const cfg_traffic *t = a->sources->list[i].traffic;
    const response_message *m = &a->sources->messages[i];
    const cw_rate rate = a->sources->config->rate;
    if (!t || m->response > a->simulated)
        return 0;
    const uint64_t last = a->simulated - m->response;
    uint64_t n = m->period == CW_NEVER ? 1 : last / m->period + 2; /* one more: ticks are rounded */
    n = t->count < n ? t->count : n;
    while (n > 0 && text_time_ticks_sum(t->offset, n - 1, t->every, rate) > last)
        n--;
    return n;
}

/* Returns how many frames of a message did not come. Those of its node with the same identifier are
 * seen as one. A frame that gives way in an arbitrating window does what it is meant to do. */
static uint64_t lost(const analysis *a, size_t i)
{
    const response_message *messages = a->sources->messages;
    const source *s = &a->sources->list[i];
    uint64_t sum = 0;
    if (s->trigger)
        return s->arbitrating ? 0 : s->given_up;
    for (size_t k = 0; a->simulated && k < a->sources->count; k++)
        if (messages[k].key == messages[i].key && messages[k].node == messages[i].node)
            sum += due(a, k);
    return sum > s->seen_count ? sum - s->seen_count : 0;
}

bool report_is_bad(const analysis *a)
{
    bool bad = false;
    for (size_t i = 0; i < a->sources->count; i++)
        bad = bad || response_is_late(&a->sources->messages[i]) || lost(a, i) ||
              exceeds(&a->sources->list[i], &a->sources->messages[i]);
    return bad;
}

/* The lengths of frames. */
typedef enum stuffing { AS_IT_IS = 0, MEAN, LONGEST } stuffing;

/* Returns the part of the bus that frames of a node take, in ppm; CW_NODES_MAX: all nodes. */
static uint64_t load_ppm(const sources *s, unsigned node, stuffing which)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < s->count; i++) {
        const response_message *m = &s->messages[i];
        const uint64_t lengths[] = {s->list[i].length, s->list[i].mean, m->length};
        const uint64_t length = lengths[which], every = s->list[i].every;
        if (every != CW_NEVER && (node == CW_NODES_MAX || m->node == node))
            sum += length * PPM / every;
    }
    return sum;
}

/* Returns the probability that more errors come in the period of a message than it survives. */
static double probability_of_late(const analysis *a, size_t i)
{
    const uint64_t period = a->sources->messages[i].period;
    const double bits = (double)period / (double)cw_rate_ticks(a->sources->config->rate, 1);
    if (a->sources->messages[i].slot)
        return failure_of_frame(a->sources->list[i].bits, a->error_rate);
    if (a->survived[i] < 0)
        return 1;
    return period == CW_NEVER ? 0 : failure_probability(a->survived[i], bits * a->error_rate);
}

typedef struct destroyed {
    double share;      /* of all frames */
    double undetected; /* in an hour */
} destroyed;

/* Returns what errors at random do to the frames. The bound for errors that nobody finds is that of
 * classical base frames. */
static destroyed find_destroyed(const analysis *a)
{
    double all = 0, bad = 0;
    for (size_t i = 0; i < a->sources->count; i++) {
        const uint64_t every = a->sources->list[i].every;
        const double rate = every == CW_NEVER ? 0 : (double)CW_CLOCK_HZ / (double)every;
        all += rate;
        bad += rate * failure_of_frame(a->sources->list[i].bits, a->error_rate);
    }
    return (destroyed){.share = all > 0 ? bad / all : 0, .undetected = bad * 3600 * UNDETECTED};
}

/* ---- Table ----------------------------------------------------------------------------------- */

/* Prints ticks as milliseconds, "-" for a time that has no bound. */
static const char *print_time(char out[CELL_MAX], uint64_t ticks)
{
    const uint64_t ns = ticks == CW_NEVER ? 0 : text_ticks_ns(ticks);
    if (ticks == CW_NEVER)
        snprintf(out, CELL_MAX, "-");
    else
        snprintf(out, CELL_MAX, "%" PRIu64 ".%03" PRIu64, ns / 1000000, ns / 1000 % 1000);
    return out;
}

static const char *print_percent(char out[CELL_MAX], uint64_t ppm)
{
    snprintf(out, CELL_MAX, "%" PRIu64 ".%" PRIu64 " %%", ppm / 10000, ppm / 1000 % 10);
    return out;
}

/* Prints the row of a message, with a word at its end when it can be late or breaks its bound. */
static void print_message(FILE *out, const analysis *a, size_t i)
{
    const source *s = &a->sources->list[i];
    const response_message *m = &a->sources->messages[i];
    char frame[FRAME_TEXT_MAX], every[CELL_MAX], blocking[CELL_MAX], response[CELL_MAX + 1],
        seen[CELL_MAX];
    text_print_frame(frame, s->frame);
    frame[strcspn(frame, "#")] = '\0';
    response[0] = '~';
    (void)print_time(response + m->fifo, m->response);
    fprintf(out, "%-12s %-8s %9s %5u %8s %9s", s->node->name, frame, print_time(every, s->every),
            s->bits, print_time(blocking, m->blocking), response);
    if (a->simulated)
        fprintf(out, " %9s", s->seen_count ? print_time(seen, s->seen) : "-");
    if (a->error_rate > 0)
        fprintf(out, " %6d %8.1e", a->survived[i], probability_of_late(a, i));
    fputs(m->response == CW_NEVER ? "  no bound" : response_is_late(m) ? "  late" : "", out);
    fputs(exceeds(s, m) ? "  above its bound" : "", out);
    if (lost(a, i))
        fprintf(out, "  %" PRIu64 " lost", lost(a, i));
    else if (s->given_up)
        fprintf(out, "  %" PRIu64 " given up", s->given_up);
    fputc('\n', out);
}

/* Prints the load of each node that sends, and of all of them, with three lengths of frames. */
static void print_loads(FILE *out, const analysis *a)
{
    const sources *s = a->sources;
    char as_it_is[CELL_MAX], mean[CELL_MAX], worst[CELL_MAX];
    fputs("\nLOAD             as it is      mean   longest\n", out);
    for (unsigned i = 0; i <= s->config->node_count; i++) {
        const bool all = i == s->config->node_count;
        const unsigned node = all ? CW_NODES_MAX : i;
        if (all || load_ppm(s, node, LONGEST))
            fprintf(out, "%-15s %9s %9s %9s\n", all ? "bus" : s->config->nodes[i].name,
                    print_percent(as_it_is, load_ppm(s, node, AS_IT_IS)),
                    print_percent(mean, load_ppm(s, node, MEAN)),
                    print_percent(worst, load_ppm(s, node, LONGEST)));
    }
}

/* Prints the rates that follow from errors at random, and the meaning of the columns. */
static void print_errors(FILE *out, const analysis *a)
{
    const destroyed d = find_destroyed(a);
    fprintf(out, "\nErrors at random: %.2g of a bit. They destroy %.2g of the frames; nobody finds "
            "%.2g errors an hour\n(at most, of base frames). ERRORS are those that a message "
            "survives in its period, P(LATE) the\nprobability of more.\n",
            a->error_rate, d.share, d.undetected);
}

/* Names the identifiers where two wrong bits may escape the CRC. */
static void print_stuffed(FILE *out, const sources *s)
{
    unsigned count = 0;
    for (size_t i = 0; i < s->count; i++) {
        char frame[FRAME_TEXT_MAX];
        if (s->list[i].id_stuff == 0)
            continue;
        text_print_frame(frame, s->list[i].frame);
        frame[strcspn(frame, "#")] = '\0';
        fprintf(out, "%s%s", count++ ? " " : "\nIdentifiers with stuff bits: ", frame);
    }
    fputs(count ? "\n" : "", out);
}

/* Returns true when any message is marked with '~'. */
static bool has_upper_bounds(const sources *s)
{
    bool any = false;
    for (size_t i = 0; i < s->count; i++)
        any = any || s->messages[i].fifo;
    return any;
}

static bool has_slots(const sources *s)
{
    bool any = false;
    for (size_t i = 0; i < s->count; i++)
        any = any || s->list[i].trigger;
    return any;
}

#define NOTES_MAX 3

/* Finds what the analysis does not know of a bus. Returns the number of texts. */
static unsigned find_notes(const char *notes[NOTES_MAX], const sources *s)
{
    unsigned count = 0;
    if (s->incomplete)
        notes[count++] = "Frames of ports, replays and replies are not among them: what they add "
                         "is not known.";
    if (s->strangers)
        notes[count++] = "Triggers of nodes whose reference message is not that of a schedule are "
                         "not among them: what they add is not known.";
    if (s->sleepers)
        notes[count++] = "Nodes may sleep: what their wake-up and wake-time add is not known.";
    return count;
}

void report_print(FILE *out, const analysis *a)
{
    fprintf(out, "%-12s %-8s %9s %5s %8s %9s", "NODE", "FRAME", "EVERY", "BITS", "BLOCKED",
            "RESPONSE");
    fputs(a->simulated ? "      SEEN" : "", out);
    fputs(a->error_rate > 0 ? " ERRORS  P(LATE)\n" : "\n", out);
    for (size_t i = 0; i < a->sources->count; i++)
        print_message(out, a, i);
    print_loads(out, a);
    print_stuffed(out, a->sources);
    if (a->error_rate > 0)
        print_errors(out, a);
    if (has_upper_bounds(a->sources))
        fputs("\nResponses with '~' are upper bounds: frames of the node wait for each other.\n",
              out);
    if (has_slots(a->sources))
        fputs("\nFrames of schedules begin in their slots, or are given up: their responses count "
              "from the\ntrigger, and are those of frames that are sent.\n", out);
    fputs("\nTimes are in ms, bits and times with the most stuff bits.\n", out);
    const char *notes[NOTES_MAX];
    const unsigned count = find_notes(notes, a->sources);
    for (unsigned i = 0; i < count; i++)
        fprintf(out, "%s\n", notes[i]);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

static json_t *json_of_ticks(uint64_t ticks)
{
    return ticks == CW_NEVER ? json_null() : json_integer((json_int_t)text_ticks_ns(ticks));
}

/* Keys that only a simulation, a schedule or errors fill are left out without these. */
static json_t *json_of_message(const analysis *a, size_t i)
{
    const source *s = &a->sources->list[i];
    const response_message *m = &a->sources->messages[i];
    char frame[FRAME_TEXT_MAX];
    text_print_frame(frame, s->frame);
    frame[strcspn(frame, "#")] = '\0';
    json_t *object = json_pack("{s:s, s:s, s:i}", "node", s->node->name, "id", frame, "bits",
                               (int)s->bits);
    put(object, "period_ns", json_of_ticks(s->every));
    put(object, "jitter_ns", json_of_ticks(m->jitter));
    put(object, "length_ns", json_of_ticks(m->length));
    put(object, "blocking_ns", json_of_ticks(m->blocking));
    put(object, "response_ns", json_of_ticks(m->response));
    put_bool(object, "exact", !m->fifo && !m->slot);
    if (s->trigger) {
        put(object, "slot_ns", json_of_ticks(m->slot));
        put_text(object, "window", s->arbitrating ? "arbitrating" : "exclusive");
    }
    put_count(object, "id_stuff_bits", s->id_stuff);
    put_bool(object, "late", response_is_late(m));
    if (a->simulated) {
        put(object, "seen_ns", s->seen_count ? json_of_ticks(s->seen) : json_null());
        put_count(object, "lost", lost(a, i));
        if (s->trigger)
            put_count(object, "given_up", s->given_up);
    }
    if (a->error_rate > 0) {
        put(object, "errors_survived", json_integer(a->survived[i]));
        put(object, "late_probability", json_real(probability_of_late(a, i)));
    }
    return object;
}

/* Returns the load in ppm with frames as they are, with random data and with the most stuff
 * bits. */
static json_t *json_of_load(const sources *s, unsigned node)
{
    return json_pack("{s:I, s:I, s:I}", "load_ppm", (json_int_t)load_ppm(s, node, AS_IT_IS),
                     "load_mean_ppm", (json_int_t)load_ppm(s, node, MEAN), "load_longest_ppm",
                     (json_int_t)load_ppm(s, node, LONGEST));
}

/* Adds the rates that follow from the rate of errors on the wire. */
static void put_errors(json_t *object, const analysis *a)
{
    const destroyed d = find_destroyed(a);
    put(object, "bit_error_rate", json_real(a->error_rate));
    put(object, "frame_error_rate", json_real(d.share));
    put(object, "undetected_per_hour", json_real(d.undetected));
}

json_t *report_json(const analysis *a)
{
    const sources *s = a->sources;
    json_t *object = json_of_load(s, CW_NODES_MAX);
    json_t *messages = json_array(), *nodes = json_array(), *texts = json_array();
    const char *notes[NOTES_MAX];
    const unsigned count = find_notes(notes, s);
    for (unsigned i = 0; i < count; i++)
        put_text_last(texts, notes[i]);
    for (size_t i = 0; i < s->count; i++)
        put_last(messages, json_of_message(a, i));
    for (unsigned i = 0; i < s->config->node_count; i++) {
        json_t *node = json_of_load(s, i);
        put_text(node, "name", s->config->nodes[i].name);
        put_last(nodes, node);
    }
    put_text(object, "bus", s->config->bus_name);
    put_bool(object, "complete", count == 0);
    put(object, "notes", texts);
    put(object, "error_every_ns", json_of_ticks(a->error_every));
    if (a->simulated)
        put(object, "simulated_ns", json_of_ticks(a->simulated));
    if (a->error_rate > 0)
        put_errors(object, a);
    put(object, "messages", messages);
    put(object, "nodes", nodes);
    return object;
}
