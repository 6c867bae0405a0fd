/* SPDX-License-Identifier: MIT
 *
 * profilefile.c - where a fault profile is looked for: it may be named, or be given as a path.
 */
#include "config/profilefile.h"

#include "base/text/nearest.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FOLDER "profiles/"
#define SHARE "/share/canwire/"

static const char *const ends[] = {"", ".yaml"}; /* that a name may lack */
static const char *const prefixes[] = {"/usr/local", "/usr"};

#define ENDS (sizeof ends / sizeof ends[0])
#define PREFIXES (sizeof prefixes / sizeof prefixes[0])

static bool is_alone(const char *name)
{
    return strchr(name, '/') == NULL;
}

bool profilefile_is_name(const char *name)
{
    return is_alone(name) || strncmp(name, FOLDER, strlen(FOLDER)) == 0;
}

/* Writes the prefix of this program's installation. Returns false for one that is searched anyway,
 * or without one. */
static bool find_own(char out[PATH_MAX])
{
    const ssize_t length = readlink("/proc/self/exe", out, PATH_MAX - 1);
    out[length > 0 ? length : 0] = '\0';
    for (int i = 0; i < 2; i++) { /* the program, and `bin` */
        char *slash = strrchr(out, '/');
        if (!slash)
            return false;
        *slash = '\0';
    }
    for (size_t i = 0; i < PREFIXES; i++)
        if (strcmp(out, prefixes[i]) == 0)
            return false;
    return true;
}

/* Writes the prefix with this number, of all installations that are searched. */
static bool print_prefix(char out[PATH_MAX], unsigned number)
{
    if (find_own(out)) {
        if (number == 0)
            return true;
        number--;
    }
    if (number >= PREFIXES)
        return false;
    strcpy(out, prefixes[number]);
    return true;
}

static void print_folder(char out[PATH_MAX], int length, const char *text, const char *end)
{
    if (snprintf(out, PATH_MAX, "%.*s%s", length, text, end) >= PATH_MAX)
        out[0] = '\0';
}

/* Writes the folder with this number, with its final '/', or "". Returns false when there are no
 * more. */
static bool profilefile_find_folder(char out[PATH_MAX], const profilefile *wanted, unsigned number)
{
    const bool alone = is_alone(wanted->name);
    for (size_t i = 0; i < PROFILEFILE_BESIDE && wanted->beside[i]; i++) {
        const char *file = wanted->name[0] == '/' ? "" : wanted->beside[i];
        const char *slash = strrchr(file, '/');
        for (int deep = 0; deep <= (int)alone; deep++)
            if (number-- == 0) {
                print_folder(out, slash ? (int)(slash - file) + 1 : 0, file, deep ? FOLDER : "");
                return true;
            }
    }
    char prefix[PATH_MAX];
    if (!profilefile_is_name(wanted->name) || !print_prefix(prefix, number))
        return false;
    print_folder(out, (int)strlen(prefix), prefix, alone ? SHARE FOLDER : SHARE);
    return true;
}

bool profilefile_place(char out[PATH_MAX], const profilefile *wanted, unsigned number)
{
    char folder[PATH_MAX];
    if (!profilefile_find_folder(folder, wanted, number / ENDS))
        return false;
    if (snprintf(out, PATH_MAX, "%s%s%s", folder, wanted->name, ends[number % ENDS]) >= PATH_MAX)
        out[0] = '\0';
    return true;
}

bool profilefile_is_there(const char *path, bool any)
{
    struct stat found;
    return fstatat(AT_FDCWD, path, &found, 0) == 0 && (any || S_ISREG(found.st_mode));
}

bool profilefile_find(char out[PATH_MAX], const profilefile *wanted)
{
    for (unsigned i = 0; profilefile_place(out, wanted, i); i++)
        if (profilefile_is_there(out, false))
            return true;
    return false;
}

/* Adds a folder to a list, without its final '/'. */
static void add_folder(char *list, const char *folder, bool last)
{
    const size_t used = strlen(list), length = strlen(folder);
    (void)snprintf(list + used, PROFILEFILE_LIST_BYTES - used, "%s%.*s",
                   used == 0 ? "" : last ? " and " : ", ", length > 0 ? (int)length - 1 : 1,
                   length > 0 ? folder : ".");
}

/* The profile whose name is nearest to the one that is wanted. */
typedef struct nearby {
    nearest guess;
    char name[NAME_MAX + 1];
} nearby;

/* Considers a file, if it is a profile by its name. */
static void consider_file(nearby *near, const char *file)
{
    char name[NAME_MAX + 1];
    const size_t length = strlen(file);
    const char *end = ends[ENDS - 1];
    if (length <= strlen(end) || length > NAME_MAX || strcmp(file + length - strlen(end), end) != 0)
        return;
    (void)snprintf(name, sizeof name, "%.*s", (int)(length - strlen(end)), file);
    nearest_consider(&near->guess, name);
    if (near->guess.best == name) {
        strcpy(near->name, name);
        near->guess.best = near->name;
    }
}

static void consider_folder(nearby *near, const char *folder, bool alone)
{
    char path[PATH_MAX];
    const int length =
        snprintf(path, sizeof path, "%s%s", *folder ? folder : "./", alone ? "" : FOLDER);
    DIR *all = length < PATH_MAX ? opendir(path) : NULL;
    const struct dirent *file;
    while (all && (file = readdir(all)))
        consider_file(near, file->d_name);
    if (all)
        (void)closedir(all);
}

void profilefile_list(char out[PROFILEFILE_LIST_BYTES], const profilefile *wanted)
{
    char folder[PATH_MAX], next[PATH_MAX], word[NAME_MAX + 1];
    const bool alone = is_alone(wanted->name);
    const char *name = wanted->name + (alone ? 0 : strlen(FOLDER));
    nearby near = {.guess = {.word = word}};
    bool more = profilefile_find_folder(next, wanted, 0);
    out[0] = '\0';
    (void)snprintf(word, sizeof word, "%.*s", (int)strcspn(name, "."), name);
    for (unsigned i = 1; more; i++) {
        strcpy(folder, next);
        more = profilefile_find_folder(next, wanted, i);
        add_folder(out, folder, !more);
        consider_folder(&near, folder, alone);
    }
    const size_t used = strlen(out);
    if (near.guess.best)
        (void)snprintf(out + used, PROFILEFILE_LIST_BYTES - used, " (did you mean '%s%s'?)",
                       alone ? "" : FOLDER, near.guess.best);
}
