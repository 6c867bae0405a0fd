/* SPDX-License-Identifier: MIT
 *
 * test_rowfile.c - a file of rows is whole or not there, whatever other programs do meanwhile.
 */
#include "cases.h"
#include "cli/campaign/rowfile.h"

#include <errno.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define PATH_BYTES 64
#define ROWS "{\"number\":0}\n"

static char folder[] = "/tmp/test_rowfile.XXXXXX";
static char name[PATH_BYTES];
static char part[PATH_BYTES];
static unsigned renames; /* of the part, before a lock is taken */
static unsigned locks;
static bool busy; /* another program keeps the lock */

/* Stands in for the kernel: another program acts between the opening and the lock. */
int flock(int fd, int operation)
{
    (void)fd;
    (void)operation;
    locks++;
    if (busy) {
        errno = EWOULDBLOCK;
        return -1;
    }
    if (renames > 0) {
        renames--;
        assert_int_equal(rename(part, name), 0);
    }
    return 0;
}

static void write_text(const char *path, const char *text)
{
    FILE *out = fopen(path, "we");
    assert_non_null(out);
    assert_int_equal(fputs(text, out) < 0, 0);
    assert_int_equal(fclose(out), 0);
}

static void assert_text(const char *path, const char *text)
{
    char found[256] = "";
    FILE *in = fopen(path, "re");
    assert_non_null(in);
    found[fread(found, 1, sizeof found - 1, in)] = '\0';
    assert_int_equal(fclose(in), 0);
    assert_string_equal(found, text);
}

static bool any_row(void *user, const char *line, size_t length)
{
    size_t *count = user;
    *count += line[length - 1] == '\n';
    return true;
}

static int set_up(void **state)
{
    (void)state;
    (void)strcpy(folder, "/tmp/test_rowfile.XXXXXX");
    assert_non_null(mkdtemp(folder));
    (void)snprintf(name, sizeof name, "%s/rows", folder);
    (void)snprintf(part, sizeof part, "%s/rows.part", folder);
    renames = 0;
    locks = 0;
    busy = false;
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    (void)unlink(name);
    (void)unlink(part);
    return rmdir(folder);
}

TEST_WITH(a_file_has_its_name_when_all_rows_are_in_it, set_up, tear_down)
{
    rowfile f;
    assert_true(rowfile_open(&f, name, false, any_row, NULL));
    assert_int_equal(fputs(ROWS, f.stream) < 0, 0);
    assert_int_equal(access(name, F_OK), -1);
    assert_true(rowfile_close(&f, true));
    assert_text(name, ROWS);
    assert_int_equal(access(part, F_OK), -1);
}

TEST_WITH(a_run_that_is_ended_leaves_its_part, set_up, tear_down)
{
    rowfile f;
    size_t count = 0;
    assert_true(rowfile_open(&f, name, false, any_row, NULL));
    assert_int_equal(fputs(ROWS "{\"num", f.stream) < 0, 0);
    assert_true(rowfile_close(&f, false));
    assert_text(part, ROWS "{\"num");
    assert_true(rowfile_open(&f, name, true, any_row, &count));
    assert_int_equal(count, 1);
    assert_int_equal(fputs("2\n", f.stream) < 0, 0);
    assert_true(rowfile_close(&f, true));
    assert_text(name, ROWS "2\n");
}

TEST_WITH(a_part_that_gets_its_name_meanwhile_is_not_written, set_up, tear_down)
{
    rowfile f;
    write_text(part, ROWS ROWS);
    renames = 1;
    assert_true(rowfile_open(&f, name, false, any_row, NULL));
    assert_int_equal(locks, 2);
    assert_text(name, ROWS ROWS); /* as the other program has left it */
    assert_int_equal(fputs(ROWS, f.stream) < 0, 0);
    assert_true(rowfile_close(&f, false));
    assert_text(part, ROWS);
    assert_text(name, ROWS ROWS);
}

TEST_WITH(a_part_that_never_stays_is_left_alone, set_up, tear_down)
{
    rowfile f;
    renames = 100;
    assert_false(rowfile_open(&f, name, false, any_row, NULL));
    assert_true(locks < 100);
    assert_true(rowfile_close(&f, false));
    assert_text(name, "");
}

TEST_WITH(a_part_with_a_lock_is_left_alone, set_up, tear_down)
{
    rowfile f;
    write_text(part, ROWS);
    busy = true;
    assert_false(rowfile_open(&f, name, false, any_row, NULL));
    assert_true(rowfile_close(&f, false));
    assert_text(part, ROWS);
}
