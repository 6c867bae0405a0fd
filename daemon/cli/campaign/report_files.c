/* SPDX-License-Identifier: MIT
 *
 * report_files.c - files of a report: no output may replace an input or another output.
 */
#include "cli/campaign/report_files.h"

#include "base/text/plain.h"
#include "campaign/report/memory.h"

#include <libgen.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STANDARD_INPUT "/proc/self/fd/0"

static bool is_dash(const char *name)
{
    return strcmp(name, "-") == 0;
}

/* Returns the one name that a file has, which need not be there yet, to be freed. */
static char *real_name(const char *name)
{
    char *real = realpath(name, NULL);
    if (real)
        return real;
    char *first = memory_text(name);
    char *second = memory_text(name);
    char *folder = realpath(dirname(first), NULL);
    char *result = memory_print("%s/%s", folder ? folder : "", basename(second));
    free(folder);
    free(first);
    free(second);
    return result;
}

static bool report_files_is_same(const char *a, const char *b)
{
    char *first = real_name(a);
    char *second = real_name(b);
    const bool same = strcmp(first, second) == 0;
    free(first);
    free(second);
    return same;
}

static bool are_one_output(const char *a, const char *b)
{
    if (is_dash(a) || is_dash(b))
        return is_dash(a) && is_dash(b);
    return report_files_is_same(a, b);
}

bool report_outputs_differ(const report_outputs *out)
{
    for (size_t i = 0; i < REPORT_OUTPUTS; i++) {
        for (size_t k = i + 1; k < REPORT_OUTPUTS; k++) {
            if (!out->name[i] || !out->name[k] || !are_one_output(out->name[i], out->name[k]))
                continue;
            plain_print(stderr, "canwire campaign: %s %s: it is the file of %s, too; give each its "
                        "own\n", out->option[k], out->name[k], out->option[i]);
            return false;
        }
    }
    return true;
}

bool report_outputs_spare(const report_outputs *out, const char *input)
{
    for (size_t i = 0; i < REPORT_OUTPUTS && input; i++) {
        const char *from = is_dash(input) ? STANDARD_INPUT : input;
        if (!out->name[i] || is_dash(out->name[i]) || !report_files_is_same(out->name[i], from))
            continue;
        plain_print(stderr, "canwire campaign: %s %s: the report reads this file, and does not "
                    "overwrite it\n", out->option[i], out->name[i]);
        return false;
    }
    return true;
}
