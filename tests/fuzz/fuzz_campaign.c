/* SPDX-License-Identifier: MIT
 *
 * fuzz_campaign.c - files of campaigns with their scenarios, and the rows that come of them.
 *
 * Input: the campaign, then behind lines "=== NAME" the files that it may name.
 */
#include "fuzz.h"

#include "base/text/yamlfile.h"
#include "campaign/runner.h"
#include "campaign/space/variant.h"
#include "parts.h"

#include <fcntl.h>
#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define PATH_BYTES 96

/* ---- The folder ------------------------------------------------------------------------------ */

static char top[] = "/tmp/fuzz_campaign.XXXXXX";
static const char *const names[] = {"campaign.yaml", "bus.yaml", "other.yaml", "rig.yaml",
                                    "profile.yaml", "drive.log"};
static pid_t owner;

static void path_of(char path[PATH_BYTES], const char *name)
{
    (void)snprintf(path, PATH_BYTES, "%s/%s", top, name);
}

static void remove_files(void)
{
    char path[PATH_BYTES];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        path_of(path, names[i]);
        (void)unlink(path);
    }
}

static void remove_folder(void)
{
    if (owner != getpid())
        return;
    remove_files();
    (void)rmdir(top);
}

static void make_folder(void)
{
    (void)strcpy(top, "/tmp/fuzz_campaign.XXXXXX");
    REQUIRE(mkdtemp(top) != NULL);
    owner = getpid();
    (void)atexit(remove_folder);
}

static bool is_allowed(const char *name)
{
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (strcmp(name, names[i]) == 0)
            return true;
    return false;
}

static void write_file(const char *name, const fuzz_part *part)
{
    char path[PATH_BYTES];
    path_of(path, name);
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    REQUIRE(fd >= 0 && write(fd, part->text, part->size) == (ssize_t)part->size);
    (void)close(fd);
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* The begin of a row is JSON as far as it goes. */
static void check_head(runner *r, uint64_t number)
{
    buffer head = {.data = NULL};
    runner_head(r, number, &head);
    buffer_put(&head, "\"}");
    json_t *object = json_loadb(buffer_first(&head), buffer_length(&head), 0, NULL);
    REQUIRE(object != NULL);
    const json_t *factors = json_object_get(object, "factors");
    REQUIRE((uint64_t)json_integer_value(json_object_get(object, "number")) == number);
    REQUIRE(json_is_object(factors));
    json_decref(object);
    buffer_free(&head);
}

/* The scenario of a row is YAML, whatever its values are; only limits may refuse it. */
static void check_scenario(const campaign *c, const choice *choices)
{
    static diag errors;
    yaml_document_t document;
    buffer text = {.data = NULL};
    errors = (diag){.file.name = "row"};
    variant_text(&text, c, choices);
    REQUIRE(!text.no_memory);
    if (yaml_text_load(&document, buffer_first(&text), buffer_length(&text),
                       &yaml_file_limits, &errors))
        yaml_document_delete(&document);
    else
        REQUIRE(errors.count == 1 && (strstr(errors.messages[0].text, "at most") ||
                                      strstr(errors.messages[0].text, "larger than") ||
                                      strstr(errors.messages[0].text, "simple key")));
    FILE *nowhere = fopen("/dev/null", "we");
    diag_flush(&errors, nowhere);
    (void)fclose(nowhere);
    buffer_free(&text);
}

static void check_row(const campaign *c, runner *r, uint64_t number)
{
    choice choices[CAMPAIGN_FACTORS_MAX];
    sample_choose(choices, c, number);
    for (size_t i = 0; i < c->factor_count; i++) {
        char text[NUMBER_TEXT_MAX];
        const factor *f = &c->factors[i];
        REQUIRE(choices[i].index < f->count);
        REQUIRE(sample_text(text, f, &choices[i]) != NULL);
    }
    check_head(r, number);
    check_scenario(c, choices);
}

static void check_campaign(const campaign *c)
{
    runner *r = runner_new(c, false);
    REQUIRE(r != NULL && c->rows > 0 && c->factor_count > 0);
    check_row(c, r, 0);
    check_row(c, r, c->rows / 2);
    check_row(c, r, c->rows - 1);
    runner_free(r);
}

/* ---- The target ------------------------------------------------------------------------------ */

/* Checks that each message is a line that begins with the name of a file. */
static void check_messages(const char *messages, bool good)
{
    REQUIRE((messages[0] == '\0') == good);
    for (const char *line = messages; *line; line = strchr(line, '\n') + 1) {
        REQUIRE(strncmp(line, top, strlen(top)) == 0 || line[0] == '/');
        REQUIRE(strchr(line, '\n') != NULL);
    }
}

static campaign *load(void)
{
    char path[PATH_BYTES];
    char *messages = NULL;
    size_t length = 0;
    FILE *errors = open_memstream(&messages, &length);
    path_of(path, names[0]);
    campaign *c = campaign_load(path, errors);
    REQUIRE(fclose(errors) == 0);
    check_messages(messages, c != NULL);
    free(messages);
    return c;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    fuzz_part parts[FUZZ_PARTS_MAX];
    if (owner != getpid())
        make_folder();
    remove_files();
    const size_t count = fuzz_split(parts, data, size);
    write_file(names[0], &parts[0]);
    for (size_t i = 1; i < count; i++)
        if (is_allowed(parts[i].head))
            write_file(parts[i].head, &parts[i]);
    campaign *c = load();
    if (c)
        check_campaign(c);
    campaign_free(c);
    return 0;
}
