/* SPDX-License-Identifier: MIT
 *
 * junit.c - test results as JUnit XML.
 */
#include "base/text/junit.h"

#include "base/text/xmltext.h"
#include "canwire.h"

#include <inttypes.h>

/* Writes a time in seconds with three decimals, since some readers accept no more. It is rounded to
 * the nearest millisecond, but a time above 0 is never shown as 0. */
static void write_time(FILE *out, uint64_t ticks)
{
    const uint64_t ms_ticks = CW_CLOCK_HZ / 1000u;
    uint64_t ms = ticks / ms_ticks + (ticks % ms_ticks >= ms_ticks / 2 ? 1 : 0);
    if (ticks == JUNIT_NO_TIME)
        return;
    if (ms == 0 && ticks > 0)
        ms = 1;
    fprintf(out, " time=\"%" PRIu64 ".%03" PRIu64 "\"", ms / 1000u, ms % 1000u);
}

static void write_counts(FILE *out, const junit_counts *counts)
{
    fprintf(out, " tests=\"%" PRIu64 "\" failures=\"%" PRIu64 "\" errors=\"%" PRIu64 "\"",
            counts->cases, counts->failures, counts->errors);
}

void junit_begin(FILE *out, const char *name, const junit_counts *counts, uint64_t ticks)
{
    fputs("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites", out);
    xml_attribute(out, "name", name);
    if (counts)
        write_counts(out, counts);
    write_time(out, ticks);
    fputs(">\n", out);
}

void junit_begin_suite(FILE *out, const char *name, const junit_counts *counts, uint64_t ticks)
{
    fputs("  <testsuite", out);
    xml_attribute(out, "name", name);
    write_counts(out, counts);
    fputs(" skipped=\"0\"", out);
    write_time(out, ticks);
    fputs(">\n", out);
}

/* A case without a problem has no content. */
void junit_write_case(FILE *out, const junit_case *one)
{
    fputs("    <testcase", out);
    xml_attribute(out, "name", one->name);
    xml_attribute(out, "classname", one->suite);
    write_time(out, one->ticks);
    if (!one->problem) {
        fputs("/>\n", out);
        return;
    }
    fprintf(out, ">\n      <%s type=\"%s\"", one->problem, one->type);
    xml_attribute(out, "message", one->message);
    fputs("/>\n    </testcase>\n", out);
}

void junit_end_suite(FILE *out)
{
    fputs("  </testsuite>\n", out);
}

void junit_end(FILE *out)
{
    fputs("</testsuites>\n", out);
}
