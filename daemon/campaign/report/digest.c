/* SPDX-License-Identifier: MIT
 *
 * digest.c - what a report takes of a row, as bytes that another process can write.
 *
 * Texts with a final 0 follow a head with numbers. First come the values of the factors; a fault of
 * a space has frame and field behind it. Then come expectations, losses, the first error, and the
 * texts of a candidate.
 */
#include "campaign/report/digest.h"

#include "campaign/report/memory.h"
#include "campaign/report/valuetext.h"

#include <stdlib.h>

#define MARK_VALUE "v"
#define MARK_SPACE "s"

typedef struct digest_head {
    uint64_t number; /* or the seed, if it has none */
    uint64_t seed;
    uint64_t end_ns;
    uint64_t latency_ns;
    row_class class;
    unsigned degraded;
    uint32_t expectations; /* texts */
    uint32_t losses;
    bool has_latency;
    bool failed;
    bool has_error;
    bool has_candidate;
    bool has_expectation;  /* of the candidate */
} digest_head;

/* ---- Writing --------------------------------------------------------------------------------- */

static void put_text_of(buffer *out, const char *text)
{
    (void)buffer_append(out, text, strlen(text) + 1);
}

/* Appends a text that printf() makes. */
static void put_printed(buffer *out, char *text)
{
    put_text_of(out, text);
    free(text);
}

/* Adds the value of each factor. A place in a frame has frame and field as well, which are counted
 * as groups. */
static void put_factors(buffer *out, const report_row *row, const report *r)
{
    buffer text = {.data = NULL};
    const jsonread_value *value = NULL;
    for (size_t i = 0; i < r->factor_count; i++) {
        const char *name = r->factors[i].name;
        value = jsonread_find(row->factors, value, name, strlen(name));
        const bool space = value_is_space(value);
        buffer_put(out, space ? MARK_SPACE : MARK_VALUE);
        put_text_of(out, value_text(&text, value));
        if (!space)
            continue;
        put_text_of(out, value_frame(value));
        put_text_of(out, value_field(&text, value));
    }
    buffer_free(&text);
}

/* Adds the failed expectations but for those that stand for a detection. Returns their number. */
static uint32_t put_expectations(buffer *out, const report_row *row, const row_signs *signs)
{
    uint32_t count = 0;
    const jsonread_value *failed = jsonread_first(row->failed);
    for (; failed; failed = jsonread_next(row->failed, failed)) {
        if (row_signs_has(signs, row_failed_name(failed)))
            continue;
        put_text_of(out, row_failed_name(failed));
        count++;
    }
    return count;
}

/* Returns a text of an object that has it. */
static const char *text_of(const jsonread_value *object, const char *key)
{
    return jsonread_string(jsonread_get(object, key));
}

/* Adds a text for each loss: rules and nodes with the reason. Returns their number. */
static uint32_t put_losses(buffer *out, const report_row *row)
{
    uint32_t count = 0;
    const jsonread_value *l = jsonread_first(row->lost);
    for (; l; l = jsonread_next(row->lost, l), count++) {
        const char *rule = text_of(l, "rule");
        put_printed(out, memory_print("%s%s: %s", rule ? "rule " : "",
                                      rule ? rule : text_of(l, "node"), text_of(l, "why")));
    }
    return count;
}

static void put_error(buffer *out, const report_row *row)
{
    const jsonread_value *e = row->first_error;
    put_printed(out, memory_print("%s at %s (%s)", text_of(e, "type"), text_of(e, "field"),
                                  text_of(e, "role")));
}

/* Adds what the shortest scenario of a class would be found by. */
static void put_candidate(buffer *out, digest_head *head, const report_row *row,
                          const row_signs *signs)
{
    const char *failed = candidate_expectation(row, signs);
    candidate_put_kind(out, row, signs);
    (void)buffer_append(out, "", 1);
    put_text_of(out, failed ? failed : "");
    put_text_of(out, row->repeat);
    head->has_expectation = failed != NULL;
}

static bool has_candidates(row_class class)
{
    return class >= CLASS_DEGRADED && class <= CLASS_CRASHED;
}

void row_digest_write(buffer *out, const report_row *row, const report *r)
{
    digest_head head = {.number = row->has_number ? row->number : row->seed,
                        .seed = row->seed,
                        .end_ns = row->end_ns,
                        .latency_ns = row->latency_ns,
                        .class = row->class,
                        .degraded = row->class == CLASS_DEGRADED ? row->facts.degraded : 0,
                        .has_latency = row->has_latency,
                        .failed = row->facts.failed,
                        .has_error = row->first_error != NULL,
                        .has_candidate = has_candidates(row->class)};
    const size_t begin = buffer_length(out);
    (void)buffer_append(out, (const char *)&head, sizeof head);
    put_factors(out, row, r);
    head.expectations = put_expectations(out, row, &r->signs);
    head.losses = put_losses(out, row);
    if (head.has_error)
        put_error(out, row);
    if (head.has_candidate)
        put_candidate(out, &head, row, &r->signs);
    (void)memory_seen(out); /* all of it is there */
    memcpy(buffer_first(out) + begin, &head, sizeof head);
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* A digest that is being read. */
typedef struct digest_part {
    digest_head head;
    const char *at;
} digest_part;

static const char *next_text(digest_part *d)
{
    const char *text = d->at;
    d->at += strlen(text) + 1;
    return text;
}

uint64_t row_digest_number(const char *digest)
{
    digest_head head;
    memcpy(&head, digest, sizeof head);
    return head.number;
}

static void digest_count(digest_part *d, dimension *of)
{
    dimension_count(of, dimension_find(of, next_text(d)), d->head.class);
}

/* Counts the values of a row, alone and in pairs. */
static void add_factors(report *r, digest_part *d)
{
    uint32_t numbers[CAMPAIGN_FACTORS_MAX] = {0};
    size_t group = 0;
    for (size_t i = 0; i < r->factor_count; i++) {
        const bool space = *d->at++ == *MARK_SPACE;
        const bool groups = space && group + 2 <= r->group_count;
        numbers[i] = dimension_find(&r->factors[i], next_text(d));
        dimension_count(&r->factors[i], numbers[i], d->head.class);
        if (groups) {
            digest_count(d, &r->groups[group++]);
            digest_count(d, &r->groups[group++]);
        } else if (space) {
            (void)next_text(d);
            (void)next_text(d);
        }
    }
    pairs_add(&r->pairs, numbers, d->head.class);
}

static void add_latency(report *r, const digest_head *head)
{
    const bool within = r->latency.has_limit && head->latency_ns <= r->latency.limit_ns;
    latency_add(&r->latency, head->latency_ns);
    r->failed_within += within && head->failed;
}

/* Hands a row that failed to the candidates of its class, which copy the texts that they keep. */
static void add_candidate(report *r, digest_part *d)
{
    const digest_head *head = &d->head;
    const char *kind = next_text(d);
    const char *expectation = next_text(d);
    const candidate one = {.kind = (char *)kind,
                           .expectation = head->has_expectation ? (char *)expectation : NULL,
                           .repeat = (char *)next_text(d),
                           .degraded = head->degraded,
                           .number = head->number,
                           .seed = head->seed,
                           .end_ns = head->end_ns};
    candidates_add(&r->candidates[head->class], &one);
}

void row_digest_add(report *r, const char *digest)
{
    digest_part d = {.at = digest + sizeof d.head};
    memcpy(&d.head, digest, sizeof d.head);
    r->rows++;
    r->classes.of[d.head.class]++;
    add_factors(r, &d);
    for (uint32_t i = 0; i < d.head.expectations; i++)
        digest_count(&d, &r->expectations);
    for (uint32_t i = 0; i < d.head.losses; i++)
        digest_count(&d, &r->lost);
    if (d.head.has_error)
        digest_count(&d, &r->errors);
    if (d.head.has_latency)
        add_latency(r, &d.head);
    if (d.head.has_candidate)
        add_candidate(r, &d);
}
