/* SPDX-License-Identifier: MIT
 *
 * test_report.c - classes, confidence intervals, latencies and spans of a report of a campaign.
 */
#include "cases.h"
#include "base/text/jsontext.h"
#include "campaign/space/class.h"
#include "campaign/space/normal.h"
#include "campaign/report/digest.h"
#include "campaign/report/latency.h"
#include "campaign/report/source.h"
#include "campaign/report/spans.h"
#include "campaign/shellword.h"

#include <math.h>

#define ROW_BYTES 2048

static void assert_near(double got, double wanted, double tolerance)
{
    if (!(fabs(got - wanted) <= tolerance))
        fail_msg("got %.9g, wanted %.9g", got, wanted);
}

/* ---- Intervals ------------------------------------------------------------------------------- */

/* Newcombe, Two-sided confidence intervals for the single proportion, Statistics in Medicine 17
 * (1998), table I, method 3; and limits that are known exactly. */
TEST(test_intervals_are_those_of_the_literature)
{
    static const struct {
        uint64_t count;
        uint64_t all;
        double low;
        double high;
    } cases[] = {
        {81, 263, 0.2553, 0.3662}, {15, 148, 0.0624, 0.1605}, {0, 20, 0, 0.1611},
        {1, 29, 0.0061, 0.1718},   {20, 20, 0.8389, 1},       {0, 0, 0, 1},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        const share s = share_of(cases[i].count, cases[i].all, 0.95);
        assert_near(s.low, cases[i].low, 0.00005);
        assert_near(s.high, cases[i].high, 0.00005);
    }
    assert_true(share_of(0, 20, 0.95).low >= 0 && share_of(20, 20, 0.95).high <= 1);
    /* of no event in n, the upper limit is z^2 / (n + z^2); z is 2.575829 for 99 % */
    assert_near(share_of(0, 100, 0.99).high, 6.634897 / 106.634897, 1e-6);
}

TEST(test_quantiles_are_those_of_tables)
{
    assert_near(normal_quantile(0.5), 0, 1e-9);
    assert_near(normal_quantile(0.975), 1.959964, 1e-6);
    assert_near(normal_quantile(0.995), 2.575829, 1e-6);
    assert_near(normal_quantile(0.01), -2.326348, 1e-6);
}

/* ---- Classes --------------------------------------------------------------------------------- */

static const row_signs no_signs = {.count = 0};
static jsonread reader; /* of one row at a time */

static report_row read_row(const char *line, const row_signs *signs)
{
    report_row row;
    const char *wrong = report_row_read(&row, &reader, line, strlen(line), signs);
    if (wrong)
        fail_msg("%s: %s", wrong, line);
    return row;
}

#define WELL "error-active"

/* Appends a node with all its keys. Counters are 0 but for one. */
static void put_node(buffer *out, const char *name, const char *state, const char *counter)
{
    static const char *const counters[] = {
        "tec", "rec", "tec_max", "rec_max", "tx_frames", "rx_frames", "retransmissions",
        "bus_errors", "undetected_errors", "dropped", "rx_dropped", "error_passive", "bus_off",
        "restarts",
    };
    jsontext_value(out, name, "{");
    jsontext_string(out, "state", state);
    for (size_t i = 0; i < COUNT(counters); i++)
        jsontext_number(out, counters[i], counter && strcmp(counter, counters[i]) == 0);
    buffer_put(out, "}");
}

/* A row in which all is well, with some keys changed. */
static void print_row(char out[ROW_BYTES], const char *word, const char *failed,
                      const char *keys, const char *state, const char *counter)
{
    buffer nodes = {.data = NULL};
    put_node(&nodes, "engine", WELL, NULL);
    put_node(&nodes, "dash", state, counter);
    (void)buffer_append(&nodes, "", 1);
    const int length =
        snprintf(out, ROW_BYTES,
                 "{\"seed\":7,\"outcome\":\"%s\",\"expectations\":{\"met\":1,\"failed\":[%s]},"
                 "\"t\":0.001,%s,\"nodes\":{%s},\"repeat\":\"canwire sim bus.yaml --seed 7\"}",
                 word, failed, keys, buffer_first(&nodes));
    assert_in_range(length, 1, ROW_BYTES - 1);
    buffer_free(&nodes);
}

#define COUNTED(errors, undetected, faults) \
    "\"frames\":1,\"error_frames\":" #errors ",\"undetected_errors\":" #undetected \
    ",\"faults\":" #faults
#define CRC_ERROR "\"first_error\":{\"t\":0.0005,\"node\":\"dash\",\"role\":\"rx\"," \
                  "\"type\":\"crc\",\"field\":\"crc-delimiter\",\"index\":0}"
#define NO_ERROR "\"first_error\":null,\"latency\":null"
#define QUIET COUNTED(0, 0, 1) "," NO_ERROR
#define SEEN COUNTED(1, 0, 1) "," CRC_ERROR ",\"latency\":0.000028000"
#define BEFORE COUNTED(1, 0, 1) "," CRC_ERROR ",\"latency\":null"
#define NO_RULE COUNTED(1, 0, 0) "," CRC_ERROR ",\"latency\":null"
#define WRONG_DATA COUNTED(0, 1, 1) "," NO_ERROR
#define LATE "{\"name\":\"late\",\"got\":\"1\"}"
#define DTC "{\"name\":\"dtc\",\"got\":\"never\"}"

TEST(test_a_row_has_the_class_that_its_page_says)
{
    static const char *const names[] = {"dtc"};
    static const row_signs signs = {.names = names, .count = 1};
    static const struct {
        const char *word;
        const char *failed;
        const char *keys;
        const char *state;
        const char *counter; /* of a node, that is 1; NULL: none */
        bool signs;
        row_class expected;
    } cases[] = {
        {"passed", "", QUIET, WELL, NULL, false, CLASS_NO_EFFECT},
        {"passed", "", SEEN, WELL, NULL, false, CLASS_CORRECTED},
        {"passed", "", NO_RULE, WELL, NULL, false, CLASS_CORRECTED},
        {"passed", "", WRONG_DATA, WELL, NULL, false, CLASS_DEGRADED},
        {"passed", "", QUIET, WELL, "dropped", false, CLASS_DEGRADED},
        {"passed", "", QUIET, WELL, "rx_dropped", false, CLASS_DEGRADED},
        {"passed", "", SEEN, WELL, "error_passive", false, CLASS_DEGRADED},
        {"passed", "", SEEN, WELL, "bus_off", false, CLASS_DEGRADED},
        {"passed", "", SEEN, "error-warning", NULL, false, CLASS_DEGRADED},
        {"failed", LATE, QUIET, WELL, NULL, false, CLASS_UNDETECTED},
        {"failed", LATE, WRONG_DATA, WELL, NULL, false, CLASS_UNDETECTED},
        {"failed", LATE, BEFORE, WELL, NULL, false, CLASS_UNDETECTED},
        {"failed", LATE, SEEN, WELL, NULL, false, CLASS_DETECTED},
        {"failed", LATE, NO_RULE, WELL, NULL, false, CLASS_DETECTED},
        {"failed", LATE "," DTC, QUIET, WELL, NULL, true, CLASS_UNDETECTED},
        {"failed", LATE, QUIET, WELL, NULL, true, CLASS_DETECTED},
        {"failed", DTC, QUIET, WELL, NULL, true, CLASS_NO_EFFECT},
        {"failed", DTC, SEEN, WELL, NULL, true, CLASS_CORRECTED},
        {"failed", DTC, QUIET, WELL, NULL, false, CLASS_UNDETECTED},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        char line[ROW_BYTES];
        print_row(line, cases[i].word, cases[i].failed, cases[i].keys, cases[i].state,
                  cases[i].counter);
        report_row row = read_row(line, cases[i].signs ? &signs : &no_signs);
        if (row.class != cases[i].expected)
            fail_msg("case %zu: %s", i, class_name(row.class));
    }
}

TEST(test_rows_without_a_result_have_a_class)
{
    static const row_class classes[] = {CLASS_TIMEOUT, CLASS_CRASHED, CLASS_INVALID, CLASS_BROKEN};
    for (size_t i = 0; i < COUNT(classes); i++) {
        char line[ROW_BYTES];
        (void)snprintf(line, sizeof line, "{\"number\":3,\"factors\":{\"a\":1},\"seed\":0,"
                       "\"outcome\":\"%s\",\"repeat\":\"canwire campaign run c.yaml --only 3\"}",
                       class_name(classes[i]));
        report_row row = read_row(line, &no_signs);
        assert_int_equal(row.class, classes[i]);
        assert_int_equal(row.number, 3);
    }
}

TEST(test_large_seeds_are_read)
{
    static const char line[] = "{\"number\":3,\"factors\":{\"a\\\"99999999999999999999\":"
                               "18446744073709551615},\"seed\":18446744073709551615,"
                               "\"outcome\":\"invalid\",\"repeat\":\"\"}";
    report_row row = read_row(line, &no_signs);
    assert_true(row.seed == UINT64_MAX);
    uint64_t number = 0;
    assert_true(jsonread_uint(&number, jsonread_get(row.factors, "a\"99999999999999999999")));
    assert_true(number == UINT64_MAX);
}

TEST(test_other_lines_are_refused)
{
    static const char *const lines[] = {
        "", "\n", "7", "[]", "{}", "{\"seed\":1}",
        "{\"seed\":-1,\"outcome\":\"invalid\",\"repeat\":\"\"}",
        "{\"seed\":1,\"outcome\":\"odd\",\"repeat\":\"\"}",
        "{\"seed\":1,\"outcome\":\"passed\",\"repeat\":\"\"}",
        "{\"seed\":1,\"number\":1,\"outcome\":\"invalid\",\"repeat\":\"\"}",
        "{\"seed\":1,\"number\":\"1\",\"factors\":{},\"outcome\":\"invalid\",\"repeat\":\"\"}",
        "{\"seed\":1,\"outcome\":\"invalid\"}",
        "{\"seed\":1,\"outcome\":\"invalid\",\"repeat\":\"\"} more",
    };
    for (size_t i = 0; i < COUNT(lines); i++) {
        report_row row;
        assert_non_null(report_row_read(&row, &reader, lines[i], strlen(lines[i]), &no_signs));
    }
}

/* ---- Latencies ------------------------------------------------------------------------------- */

TEST(test_each_latency_is_in_its_class)
{
    for (unsigned i = 1; i < LATENCY_CLASSES; i++) {
        latency *l = calloc(1, sizeof *l);
        const uint64_t first = latency_class_end(i - 1) + 1;
        assert_true(first > latency_class_end(i - 1));
        latency_add(l, first);
        latency_add(l, latency_class_end(i));
        assert_int_equal(l->classes[i], 2);
        assert_true((double)(latency_class_end(i) - first) <= 0.0079 * (double)first);
        free(l);
    }
    assert_true(latency_class_end(LATENCY_CLASSES - 1) == UINT64_MAX);
}

TEST(test_percentiles_are_nearest_ranks)
{
    latency *l = calloc(1, sizeof *l);
    assert_int_equal(latency_percentile(l, 500), 0);
    l->has_limit = true;
    l->limit_ns = 30;
    for (uint64_t ns = 200; ns > 0; ns--)
        latency_add(l, ns);
    assert_int_equal(latency_percentile(l, 500), 100);
    assert_int_equal(latency_percentile(l, 950), 190);
    assert_int_equal(latency_percentile(l, 990), 198);
    assert_int_equal(latency_percentile(l, 1000), 200);
    assert_int_equal(l->within, 30);
    latency_add(l, 1000000007);
    assert_int_equal(latency_percentile(l, 1000), 1000000007); /* never above the highest */
    assert_int_equal(l->min_ns, 1);
    free(l);
}

/* ---- Spans ----------------------------------------------------------------------------------- */

TEST(test_spans_hold_numbers_in_any_order)
{
    enum { NUMBERS = 1000 };
    spans s = {.count = 0};
    for (unsigned i = 0; i < NUMBERS; i++)
        assert_true(spans_add(&s, i * 617 % NUMBERS)); /* each number once */
    assert_int_equal(s.count, 1);
    assert_int_equal(s.list[0].first, 0);
    assert_int_equal(s.list[0].last, NUMBERS - 1);
    for (unsigned i = 0; i < NUMBERS; i++)
        assert_false(spans_add(&s, i));
    assert_true(spans_add(&s, UINT64_MAX));
    assert_true(spans_add(&s, UINT64_MAX - 2));
    assert_int_equal(s.count, 3);
    assert_true(spans_add(&s, UINT64_MAX - 1));
    assert_int_equal(s.count, 2);
    assert_false(spans_add(&s, UINT64_MAX));
    spans_free(&s);
}

/* ---- Commands -------------------------------------------------------------------------------- */

TEST(test_words_come_back_as_they_were)
{
    static const char *const words[] = {"a b.yaml", "it's", "", "'", "\\", "x\"$(y)\n"};
    buffer line = {.data = NULL};
    buffer word = {.data = NULL};
    shellword_begin(&line, "canwire campaign run", "dir with 'quotes'/c.yaml");
    for (size_t i = 0; i < COUNT(words); i++) {
        buffer_put(&line, " ");
        shellword_put(&line, words[i]);
    }
    (void)buffer_append(&line, "", 1);
    const char *rest = buffer_first(&line);
    for (size_t i = 0; i < 3; i++)
        assert_true(shellword_take(&word, &rest));
    assert_true(shellword_take(&word, &rest));
    assert_string_equal(buffer_first(&word), "dir with 'quotes'/c.yaml");
    for (size_t i = 0; i < COUNT(words); i++) {
        assert_true(shellword_take(&word, &rest));
        assert_string_equal(buffer_first(&word), words[i]);
    }
    assert_false(shellword_take(&word, &rest));
    buffer_free(&line);
    buffer_free(&word);
}

/* ---- Candidates ------------------------------------------------------------------------------ */

/* Adds rows number 0 to 199, in an order that `step` makes. There are 100 kinds of failures. */
static void add_candidates(report *r, unsigned step)
{
    buffer digest = {.data = NULL};
    for (unsigned i = 0; i < 200; i++) {
        char line[ROW_BYTES];
        const unsigned number = i * step % 200;
        (void)snprintf(line, sizeof line, "{\"seed\":%u,\"outcome\":\"failed\",\"expectations\":"
                       "{\"met\":0,\"failed\":[{\"name\":\"e%u\"}]},\"t\":0.00%u," QUIET
                       ",\"nodes\":{},"
                       "\"repeat\":\"canwire sim b\"}", number, number / 2, number % 7);
        report_row row = read_row(line, &no_signs);
        if (i == 0)
            report_begin(r, &row, NULL);
        buffer_clear(&digest);
        row_digest_write(&digest, &row, r);
        row_digest_add(r, buffer_first(&digest));
    }
    buffer_free(&digest);
}

TEST(test_candidates_do_not_depend_on_the_order_of_rows)
{
    report one = {.rows = 0};
    report other = {.rows = 0};
    add_candidates(&one, 1);
    add_candidates(&other, 63);
    const candidates *a = &one.candidates[CLASS_UNDETECTED];
    const candidates *b = &other.candidates[CLASS_UNDETECTED];
    assert_int_equal(one.rows, 200);
    assert_int_equal(a->count, CANDIDATES_MAX);
    assert_int_equal(b->count, CANDIDATES_MAX);
    for (size_t i = 0; i < CANDIDATES_MAX; i++) {
        assert_int_equal(a->list[i].number, b->list[i].number);
        assert_string_equal(a->list[i].kind, b->list[i].kind);
        for (size_t k = 0; k < i; k++)
            assert_string_not_equal(a->list[i].kind, a->list[k].kind);
        assert_true(i == 0 || a->list[i - 1].end_ns <= a->list[i].end_ns);
    }
    report_free(&one);
    report_free(&other);
}
