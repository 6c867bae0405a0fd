/* SPDX-License-Identifier: MIT
 *
 * test_metrics_request.c - what programs ask for by HTTP where metrics are read.
 */
#include "cases.h"
#include "serve/metrics_request.h"

static metrics_request read_text(const char *text)
{
    return metrics_request_read(text, strlen(text));
}

TEST(a_request_is_whole_at_its_empty_line_and_at_its_limit)
{
    char many[METRICS_REQUEST_MAX + 1];
    memset(many, 'x', sizeof many);
    assert_false(metrics_request_is_whole("GET /metrics HTTP/1.1\r\n", 23));
    assert_true(metrics_request_is_whole("GET /metrics HTTP/1.1\r\n\r\n", 25));
    assert_true(metrics_request_is_whole("GET /metrics HTTP/1.1\n\nmore", 27));
    assert_true(metrics_request_is_whole("GET /metrics HTTP/1.1\n\r\nmore", 28));
    assert_true(metrics_request_is_whole("GET /metrics HTTP/1.1\r\n\n", 24));
    assert_false(metrics_request_is_whole("GET /metrics HTTP/1.1\n\r", 23));
    assert_false(metrics_request_is_whole("GET /metrics HTTP/1.1\n\rX\n", 25));
    assert_false(metrics_request_is_whole(many, METRICS_REQUEST_MAX));
    assert_true(metrics_request_is_whole(many, sizeof many));
    assert_int_equal(metrics_request_read(many, sizeof many).status, 431);
}

TEST(an_empty_line_before_a_request_is_ignored)
{
    static const char *const before[] = {"", "\r\n", "\n"};
    for (size_t i = 0; i < sizeof before / sizeof before[0]; i++) {
        char text[100];
        const int length = snprintf(text, sizeof text, "%sHEAD /metrics HTTP/1.1\n\r\n", before[i]);
        for (int part = 0; part < length; part++)
            assert_false(metrics_request_is_whole(text, (size_t)part));
        assert_true(metrics_request_is_whole(text, (size_t)length));
        assert_int_equal(read_text(text).status, 200);
        assert_true(read_text(text).head);
    }
    assert_true(metrics_request_is_whole("\r\n\r\n", 4));
    assert_int_equal(read_text("\r\n\r\n").status, 400);
    assert_int_equal(read_text("\n\nGET /metrics HTTP/1.1\n\n").status, 400);
}

TEST(each_piece_of_the_first_line_has_its_error)
{
    static const struct {
        const char *text;
        unsigned status;
        bool head;
    } lines[] = {
        {"GET /metrics HTTP/1.1", 200, false},  {"GET /metrics?a=b HTTP/1.0", 200, false},
        {"HEAD /metrics HTTP/1.1", 200, true},  {"GET / HTTP/1.1", 404, false},
        {"GET /metric HTTP/1.1", 404, false},   {"GET /metrics/ HTTP/1.1", 404, false},
        {"get /metrics HTTP/1.1", 405, false},  {"PUT /metrics HTTP/1.1", 405, false},
        {"GET /metrics HTTP/2", 505, false},    {"GET /metrics HTTP/3.0", 505, false},
        {"GET /metrics FTP/1.1", 400, false},   {"GET /metrics", 400, false},
        {"GET  /metrics HTTP/1.1", 400, false}, {"GET /metrics HTTP/1.1 x", 400, false},
        {"", 400, false},
        {"GET http://a/metrics HTTP/1.1", 200, false},
        {"HEAD HTTP://[::1]:9464/metrics?a=/b HTTP/1.1", 200, true},
        {"GET http://a/ HTTP/1.1", 404, false}, {"GET http://a HTTP/1.1", 404, false},
        {"GET http:// HTTP/1.1", 404, false},   {"GET http:///metrics HTTP/1.1", 404, false},
        {"GET http://a/b/metrics HTTP/1.1", 404, false},
        {"GET http://a?/metrics HTTP/1.1", 404, false},
        {"GET ftp://a/metrics HTTP/1.1", 404, false},
    };
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        char text[100];
        (void)snprintf(text, sizeof text, "%s\r\nHost: a\r\n\r\n", lines[i].text);
        const metrics_request request = read_text(text);
        assert_int_equal(request.status, lines[i].status);
        assert_int_equal(request.head, lines[i].head);
    }
    assert_int_equal(metrics_request_read("GET /metrics HTTP/1.1\0\n\n", 24).status, 400);
}

/* Returns true when a program that accepts this gets OpenMetrics. */
static bool gets_openmetrics(const char *accept)
{
    char text[300];
    (void)snprintf(text, sizeof text, "GET /metrics HTTP/1.1\r\naccept:%s\r\nX: text/plain\r\n\r\n",
                   accept);
    return read_text(text).openmetrics;
}

TEST(the_older_text_is_for_those_who_prefer_it)
{
    assert_true(gets_openmetrics(""));
    assert_true(gets_openmetrics(" */*"));
    assert_true(gets_openmetrics("text/html,application/xhtml+xml,*/*;q=0.8"));
    assert_true(gets_openmetrics("application/openmetrics-text; version=1.0.0; charset=utf-8"));
    assert_true(gets_openmetrics("text/plain;q=0.5,application/openmetrics-text;version=0.0.1"));
    assert_true(gets_openmetrics("application/*, text/plain; q=0.999"));
    assert_false(gets_openmetrics(" text/plain"));
    assert_false(gets_openmetrics("TEXT/*"));
    assert_false(gets_openmetrics("*/*;q=0.1, text/plain;q=0.2"));
    assert_false(gets_openmetrics("application/openmetrics-text;version=9.0.0, text/plain;q=0.1"));
    assert_false(gets_openmetrics("application/openmetrics-text;q=0, */*"));
    assert_false(gets_openmetrics("application/openmetrics-text;q=zero, text/plain"));
}

TEST(lines_of_accept_count_together)
{
    assert_false(gets_openmetrics("text/plain\r\nAccept: */*;q=0.5"));
    assert_false(gets_openmetrics("*/*;q=0.5\r\nAccept: text/plain"));
    assert_true(gets_openmetrics("text/plain;q=0.5\r\nACCEPT:application/openmetrics-text"));
    assert_false(gets_openmetrics("text/plain\r\nAccept:"));
    assert_false(gets_openmetrics("text/plain\r\n\r\nAccept: application/openmetrics-text"));
}

/* Returns the status for a program that accepts this. */
static unsigned status_for(const char *accept)
{
    char text[300];
    (void)snprintf(text, sizeof text, "GET /metrics HTTP/1.1\nAccept:%s\n\n", accept);
    return read_text(text).status;
}

TEST(a_weight_of_nothing_refuses_a_kind)
{
    assert_false(gets_openmetrics("application/openmetrics-text;q=0"));
    assert_int_equal(status_for("application/openmetrics-text;q=0"), 200);
    assert_true(gets_openmetrics("text/plain;q=0"));
    assert_int_equal(status_for("text/plain;q=0.000"), 200);
    assert_int_equal(status_for("*/*;q=0"), 406);
    assert_int_equal(status_for("text/*;q=0, application/*; q=0.0"), 406);
    assert_int_equal(status_for("*/*;q=0, text/plain"), 200);
    assert_false(gets_openmetrics("*/*;q=0, text/plain"));
    assert_int_equal(status_for("image/png"), 200); /* does not say that it refuses ours */
    assert_int_equal(read_text("GET / HTTP/1.1\nAccept: */*;q=0\n\n").status, 404);
}

TEST(an_answer_has_its_length_and_only_get_has_a_text)
{
    char answer[METRICS_HEAD_BYTES];
    metrics_request request = {.status = 200, .openmetrics = true};
    const size_t whole = metrics_request_answer(answer, &request, 4711);
    assert_int_equal(whole, strlen(answer));
    assert_non_null(strstr(answer, "Content-Length: 4711\r\n"));
    assert_non_null(strstr(answer, "openmetrics-text; version=1.0.0; charset=utf-8\r\n"));
    for (unsigned status = 400; status <= 505; status++) {
        if (status != 400 && (status < 404 || status > 406) && status != 431 && status != 503 &&
            status != 505)
            continue;
        unsigned long length = 0;
        request = (metrics_request){.status = status};
        (void)metrics_request_answer(answer, &request, 0);
        const char *text = strstr(answer, "\r\n\r\n") + 4;
        assert_int_equal(sscanf(strstr(answer, "Content-Length: "), "Content-Length: %lu", &length),
                         1);
        assert_int_equal(length, strlen(text));
        request.head = true;
        assert_int_equal(metrics_request_answer(answer, &request, 0), text - answer);
    }
}
