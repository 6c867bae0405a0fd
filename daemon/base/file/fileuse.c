/* SPDX-License-Identifier: MIT
 *
 * fileuse.c - files that are read and written by one program: no file that is written may have
 * another use, under any name.
 *
 * Each use has places: the file itself and its names after rotations. Equal places are neighbours
 * once the places are sorted by inode, and then by folder and name.
 */
#include "base/file/fileuse.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LINKS_MAX 40 /* symbolic links in a chain, the kernel's limit */

typedef struct place {
    size_t use;
    unsigned number; /* 0: the file itself, k: PATH.k */
    bool exists;
    dev_t device; /* of a file that exists */
    ino_t inode;
    bool has_folder;
    dev_t folder_device;
    ino_t folder_inode;
    char *name; /* in the folder */
} place;

typedef struct places {
    place *all;
    size_t count;
} places;

/* A pair of uses that name the same file. */
typedef struct clash {
    const place *own;
    const place *other; /* NULL: nothing */
} clash;

/* Without memory the list is incomplete, and no check of it succeeds. */
void fileuses_add(fileuses *all, const fileuse *use)
{
    fileuse *uses = realloc(all->uses, (all->count + 1) * sizeof *uses);
    if (uses) {
        all->uses = uses;
        all->uses[all->count++] = *use;
    }
    all->incomplete = all->incomplete || !uses;
}

void fileuses_add_socket(fileuses *all, const fileuse *use)
{
    fileuse made = *use;
    made.written = true;
    made.socket = true;
    fileuses_add(all, &made);
    made.socket = false;
    made.lock = true;
    fileuses_add(all, &made);
}

void fileuses_free(fileuses *all)
{
    free(all->uses);
    *all = (fileuses){.count = 0};
}

/* ---- Places ---------------------------------------------------------------------------------- */

static const char *behind_path(const fileuse *use)
{
    return use->lock ? ".lock" : "";
}

/* Returns "PATH.3", to be freed. Number 0 is PATH itself, or its lock. */
static char *numbered(const fileuse *use, unsigned number)
{
    char *text = NULL;
    int length = number == 0 ? asprintf(&text, "%s%s", use->path, behind_path(use))
                             : asprintf(&text, "%s.%u", use->path, number);
    return length < 0 ? NULL : text;
}

/* Replaces a path by the target of its symbolic links; another path stays. Opening it for writing
 * would create that target. */
static void follow_links(char path[PATH_MAX])
{
    for (unsigned i = 0; i < LINKS_MAX; i++) {
        char target[PATH_MAX];
        ssize_t length = readlink(path, target, sizeof target - 1);
        if (length < 0)
            return;
        target[length] = '\0';
        char *slash = strrchr(path, '/');
        char *to = target[0] != '/' && slash ? slash + 1 : path;
        if ((size_t)(to - path) + (size_t)length >= PATH_MAX)
            return;
        memcpy(to, target, (size_t)length + 1);
    }
}

/* Finds the folder of a path and the name there. Returns false when there is no memory. */
static bool fileuse_find_folder(place *p, const char *path)
{
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;
    char *folder = length > 0 ? strndup(path, length) : strdup(".");
    struct stat found;
    p->name = strdup(path + length);
    p->has_folder = folder && stat(folder, &found) == 0;
    if (p->has_folder) {
        p->folder_device = found.st_dev;
        p->folder_inode = found.st_ino;
    }
    free(folder);
    return folder && p->name;
}

/* Takes the inode of a place. Returns false when the file may have many uses. */
static bool take_status(place *p, bool found, const struct stat *status)
{
    p->exists = found;
    if (!found)
        return true;
    p->device = status->st_dev;
    p->inode = status->st_ino;
    return S_ISREG(status->st_mode) || S_ISSOCK(status->st_mode);
}

typedef enum finding { FOUND_PLACE, FOUND_SPECIAL, FOUND_NO_MEMORY } finding;

static finding find_stdout(place *p)
{
    struct stat status;
    bool found = fstat(STDOUT_FILENO, &status) == 0;
    return take_status(p, found, &status) && found ? FOUND_PLACE : FOUND_SPECIAL;
}

/* Finds the file of a place. Links are followed for the file itself, which is opened by path.
 * Rotated names and sockets are not followed. */
static finding fileuse_find_place(place *p, const fileuse *use)
{
    char path[PATH_MAX];
    struct stat status;
    if (strcmp(use->path, "-") == 0)
        return find_stdout(p);
    char *text = numbered(use, p->number);
    if (!text)
        return FOUND_NO_MEMORY;
    (void)snprintf(path, sizeof path, "%s", text);
    free(text);
    bool found = (p->number == 0 ? stat(path, &status) : lstat(path, &status)) == 0;
    if (!take_status(p, found, &status))
        return FOUND_SPECIAL;
    if (p->number == 0 && !use->socket)
        follow_links(path);
    return fileuse_find_folder(p, path) ? FOUND_PLACE : FOUND_NO_MEMORY;
}

/* Each use has its file and all names that rotations give that. */
static size_t count_places(const fileuses *all)
{
    size_t count = 0;
    for (size_t i = 0; i < all->count; i++)
        count += 1 + all->uses[i].older;
    return count;
}

/* Adds the places of a use. Returns false when there is no memory. */
static bool add_places(places *found, const fileuses *all, size_t use)
{
    for (unsigned number = 0; number <= all->uses[use].older; number++) {
        place *p = &found->all[found->count];
        *p = (place){.use = use, .number = number};
        finding result = fileuse_find_place(p, &all->uses[use]);
        if (result == FOUND_PLACE)
            found->count++;
        else
            free(p->name);
        if (result == FOUND_NO_MEMORY)
            return false;
    }
    return true;
}

/* Finds all places. Returns false without memory, also when the list lacks a use. */
static bool find_places(places *found, const fileuses *all)
{
    *found = (places){.all = calloc(count_places(all) + 1, sizeof *found->all)};
    bool good = found->all && !all->incomplete;
    for (size_t i = 0; i < all->count && good; i++)
        good = add_places(found, all, i);
    return good;
}

static void free_places(places *found)
{
    for (size_t i = 0; i < found->count; i++)
        free(found->all[i].name);
    free(found->all);
}

/* ---- Equal places ---------------------------------------------------------------------------- */

#define ORDER(a, b) (((a) > (b)) - ((a) < (b)))

static int by_use(const place *a, const place *b)
{
    return a->use != b->use ? ORDER(a->use, b->use) : ORDER(a->number, b->number);
}

/* Returns 0 for the same file. Missing files come first, as one group, in which nothing clashes. */
static int compare_files(const place *a, const place *b)
{
    if (a->exists != b->exists || !a->exists)
        return ORDER(a->exists, b->exists);
    return a->device != b->device ? ORDER(a->device, b->device) : ORDER(a->inode, b->inode);
}

/* Returns 0 for the same name in one folder. Places without a folder come first, as one group, in
 * which nothing clashes. */
static int compare_names(const place *a, const place *b)
{
    if (a->has_folder != b->has_folder || !a->has_folder)
        return ORDER(a->has_folder, b->has_folder);
    if (a->folder_device != b->folder_device)
        return ORDER(a->folder_device, b->folder_device);
    if (a->folder_inode != b->folder_inode)
        return ORDER(a->folder_inode, b->folder_inode);
    return strcmp(a->name, b->name);
}

static int sort_by_file(const void *a, const void *b)
{
    int order = compare_files(a, b);
    return order != 0 ? order : by_use(a, b);
}

static int sort_by_name(const void *a, const void *b)
{
    int order = compare_names(a, b);
    return order != 0 ? order : by_use(a, b);
}

/* Notes a clash for the later of two uses of one file. */
static void note(clash *clashes, const fileuses *all, const place *a, const place *b)
{
    const place *later = a->use > b->use ? a : b;
    const place *earlier = a->use > b->use ? b : a;
    bool matters = later->use != earlier->use &&
                   (all->uses[a->use].written || all->uses[b->use].written);
    if (matters && !clashes[later->use].other)
        clashes[later->use] = (clash){later, earlier};
}

/* Notes clashes of equal places, in the order of their uses. Each use clashes with the first one,
 * and with the first that writes. */
static void note_same(clash *clashes, const fileuses *all, const place *same, size_t count)
{
    const place *written = NULL;
    for (size_t i = 0; i < count && !written; i++)
        written = all->uses[same[i].use].written ? &same[i] : NULL;
    for (size_t i = 0; i < count && written; i++) {
        note(clashes, all, &same[i], &same[0]);
        note(clashes, all, &same[i], written);
    }
}

static bool is_there(const place *p)
{
    return p->exists;
}

static bool has_folder(const place *p)
{
    return p->has_folder;
}

/* A criterion by which two places can be the same. */
typedef struct likeness {
    bool (*can_be)(const place *p);
    int (*compare)(const place *a, const place *b);
    int (*sort)(const void *a, const void *b);
} likeness;

static const likeness by_inode = {is_there, compare_files, sort_by_file};
static const likeness by_name = {has_folder, compare_names, sort_by_name};

/* Sorts the places and notes the clashes in each group of equal ones. */
static void note_all(clash *clashes, const fileuses *all, places *found, const likeness *how)
{
    qsort(found->all, found->count, sizeof *found->all, how->sort);
    for (size_t i = 0, end; i < found->count; i = end) {
        const place *first = &found->all[i];
        for (end = i + 1; end < found->count && how->compare(first, &found->all[end]) == 0;)
            end++;
        if (how->can_be(first))
            note_same(clashes, all, first, end - i);
    }
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Prints the use and the path; with a number also the name that rotations give the file. */
static void print_use(FILE *errors, const fileuse *use, unsigned number)
{
    bool standard = strcmp(use->path, "-") == 0;
    fprintf(errors, "%s%s%s%s", use->what, *use->what ? " " : "",
            standard ? "standard output" : use->path, behind_path(use));
    if (number > 0)
        fprintf(errors, ", which is rotated to %s.%u", use->path, number);
}

/* Reports both uses, at the place of the one that is to be changed. */
static void fileuse_report(FILE *errors, const fileuses *all, const clash *c, const char *program)
{
    const fileuse *own = &all->uses[c->own->use];
    const fileuse *other = &all->uses[c->other->use];
    if (own->file)
        fprintf(errors, "%s:%d:%d: ", own->file, own->line, own->column);
    else
        fprintf(errors, "%s: ", program);
    print_use(errors, own, c->own->number);
    fputs(c->own->number > 0 ? ", is the same file as " : " is the same file as ", errors);
    print_use(errors, other, c->other->number);
    if (other->file)
        fprintf(errors, " (%s:%d:%d)", other->file, other->line, other->column);
    fputs(": one of them would spoil the other\n", errors);
}

/* Returns true when there is no clash to report. */
static bool fileuse_compare(const fileuses *all, places *found, const likeness *how,
                            const char *program, FILE *errors)
{
    clash *clashes = calloc(all->count + 1, sizeof *clashes);
    bool good = clashes != NULL;
    if (!clashes)
        fprintf(errors, "%s: out of memory\n", program);
    else
        note_all(clashes, all, found, how);
    for (size_t i = 0; clashes && i < all->count; i++)
        if (clashes[i].other) {
            fileuse_report(errors, all, &clashes[i], program);
            good = false;
        }
    free(clashes);
    return good;
}

bool fileuses_check(const fileuses *all, const char *program, FILE *errors)
{
    places found;
    bool good = find_places(&found, all);
    if (!good)
        fprintf(errors, "%s: out of memory\n", program);
    good = good && fileuse_compare(all, &found, &by_inode, program, errors) &&
           fileuse_compare(all, &found, &by_name, program, errors);
    free_places(&found);
    return good;
}
