/* SPDX-License-Identifier: MIT
 *
 * cases.h - what each unit test has: cmocka with the headers that it wants, and a list of tests
 * that makes itself. A file has its tests where they stand in it, and main() is in cases.c.
 */
#ifndef CANWIRE_TEST_CASES_H
#define CANWIRE_TEST_CASES_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

/* TEST(name) { ... } is a test. TEST_WITH() calls one function before and one behind it, either of
 * them may be NULL; the body then finds its `*state`. */
#define TEST(test) TEST_WITH(test, NULL, NULL)
#define TEST_WITH(test, before, behind)                                                            \
    static void test(void **state);                                                                \
    __attribute__((constructor)) static void test##_is_added(void)                                 \
    {                                                                                              \
        cases_add((struct CMUnitTest){#test, test, before, behind, NULL}, __LINE__);               \
    }                                                                                              \
    static void test(__attribute__((unused)) void **state)

/* TEST_ROWS(name, rows) { ... } is a test of each row of an array; `*state` is the row, and its
 * member `name` the name of the test. */
#define TEST_ROWS(test, rows)                                                                      \
    static void test(void **state);                                                                \
    __attribute__((constructor)) static void test##_is_added(void)                                 \
    {                                                                                              \
        for (size_t i = 0; i < COUNT(rows); i++)                                                   \
            cases_add((struct CMUnitTest){(rows)[i].name, test, NULL, NULL,                        \
                                          (void *)(uintptr_t)&(rows)[i]},                          \
                      __LINE__);                                                                   \
    }                                                                                              \
    static void test(void **state)

/* Calls one function before all tests of the file and one behind them. */
#define TESTS_WITH(before, behind)                                                                 \
    __attribute__((constructor)) static void tests_have_a_frame(void)                              \
    {                                                                                              \
        cases_frame(before, behind);                                                               \
    }

/* A pointer with FREED before it is freed where its block ends. */
#define FREED __attribute__((cleanup(cases_freed)))
static inline void cases_freed(void *pointer)
{
    free(*(void **)pointer);
}

/* For the macros. Tests run in the order of their lines. */
void cases_add(struct CMUnitTest test, unsigned line);
void cases_frame(CMFixtureFunction before, CMFixtureFunction behind);

#endif
