/* SPDX-License-Identifier: MIT
 *
 * files.c - `canwire campaign files`: what another machine needs to run a campaign.
 */
#include "cli/campaign/parts.h"

#include "campaign/scenario.h"
#include "cli/cli.h"
#include "config/files.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

/* Writes a path without parts such as `folder/..`, as its text says. */
static void cut_detours(char *out, const char *path)
{
    char *end = out;
    char *least = out; /* behind the `..` that stay */
    if (*path == '/')
        least = end = stpcpy(out, "/");
    while (*path) {
        const size_t length = strcspn(path, "/");
        const bool up = length == 2 && strncmp(path, "..", 2) == 0;
        const bool slash = path[length] == '/';
        if (up && end > least) {
            do
                end--;
            while (end > least && end[-1] != '/');
        } else if (length > 1 || (length == 1 && *path != '.')) {
            memcpy(end, path, length + slash);
            end += length + slash;
            least = up ? end : least;
        }
        path += length + slash;
    }
    *end = '\0';
}

/* Prints a path; programs that copy files mostly refuse detours. */
static bool print_path(const char *path)
{
    struct stat long_way;
    struct stat short_way;
    char *cut = malloc(strlen(path) + 1);
    if (!cut)
        return false;
    cut_detours(cut, path);
    const bool same = stat(path, &long_way) == 0 && stat(cut, &short_way) == 0 &&
                      long_way.st_ino == short_way.st_ino && long_way.st_dev == short_way.st_dev;
    puts(same ? cut : path); /* a link makes a difference */
    free(cut);
    return true;
}

/* Prints each path once, the first one first. */
static bool print_paths(const fileuses *all)
{
    bool good = !all->incomplete;
    for (size_t i = 0; i < all->count && good; i++) {
        size_t earlier = 0;
        while (strcmp(all->uses[earlier].path, all->uses[i].path) != 0)
            earlier++;
        if (earlier == i)
            good = print_path(all->uses[i].path);
    }
    return good;
}

/* Prints the files that a campaign reads, so that they can be brought to another machine. */
int campaign_files(const campaign *c)
{
    fileuses all = {.count = 0};
    const cfg_file file = {.name = c->scenario_name, .text = c->text, .size = c->size};
    scenario *s = scenario_open(&file, stderr);
    if (!s)
        return CLI_BAD_INPUT;
    fileuses_add(&all, &(fileuse){.what = "campaign", .path = c->file});
    if (s->rig)
        fileuses_add(&all, &(fileuse){.what = "rig", .path = c->scenario_name});
    for (size_t i = 0; i < s->count; i++)
        cfg_add_files_read(&all, s->buses[i].config);
    const bool good = print_paths(&all);
    if (!good)
        fputs("canwire campaign: out of memory\n", stderr);
    fileuses_free(&all);
    scenario_close(s);
    return good ? CLI_OK : CLI_BAD_INPUT;
}
