/* SPDX-License-Identifier: MIT
 *
 * journal_pack.c - packs the text of a journal with zstd, and unpacks it again.
 */
#include "run/journal_pack.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zstd.h>

#define LEVEL 1       /* higher ones cost more, and gain little with blocks of some lines */
#define WINDOW_LOG 17 /* a frame */
#define ROOM (64u * 1024u)
#define READ_BYTES (64u * 1024u)

/* ---- Packing --------------------------------------------------------------------------------- */

typedef struct packer {
    ZSTD_CCtx *zstd;
    bool steady;  /* blocks depend on the text alone */
    char *bytes;
    size_t used;
    size_t room;
    size_t text;  /* bytes of this frame */
    bool open;    /* a frame has begun ... */
    bool settled; /* ... in the file, up to the last time that all was written */
    bool anew;    /* zstd knows a frame that is not in the file as it is */
} packer;

/* A block without content that ends a frame, by RFC 8878. */
static const char last_block[] = {1, 0, 0};

static void append(packer *p, const char *bytes, size_t count)
{
    memcpy(p->bytes + p->used, bytes, count);
    p->used += count;
}

/* Ends the frame that is in the file, since the next one knows nothing of it. */
static void begin_anew(packer *p)
{
    (void)ZSTD_CCtx_reset(p->zstd, ZSTD_reset_session_only);
    if (p->settled)
        append(p, last_block, sizeof last_block);
    p->anew = false;
    p->open = false;
    p->text = 0;
}

/* Makes room for so many more packed bytes. */
static bool reserve(packer *p, size_t count)
{
    if (p->room - p->used >= count)
        return true;
    const size_t room = p->used + count;
    char *bytes = realloc(p->bytes, room);
    if (!bytes)
        return false;
    p->bytes = bytes;
    p->room = room;
    return true;
}

/* Packs a text; returns false without memory. */
static bool compress(packer *p, const char *text, size_t size, ZSTD_EndDirective how)
{
    ZSTD_inBuffer in = {text, size, 0};
    size_t left;
    do {
        if (!reserve(p, ZSTD_CStreamOutSize()))
            return false;
        ZSTD_outBuffer out = {p->bytes, p->room, p->used};
        left = ZSTD_compressStream2(p->zstd, &out, &in, how);
        p->used = out.pos;
    } while (!ZSTD_isError(left) && (in.pos < size || (how != ZSTD_e_continue && left > 0)));
    return !ZSTD_isError(left);
}

/* Ends the frame, without text: with some, blocks would depend on how much that is. */
static bool end_frame(packer *p)
{
    p->open = false;
    p->text = 0;
    return compress(p, NULL, 0, ZSTD_e_end);
}

/* Packs a text in pieces, each of which ends a block. */
static bool pack_pieces(packer *p, const char *text, size_t size)
{
    const size_t piece = p->steady ? JOURNAL_PACK_PIECE : JOURNAL_PACK_FRAME;
    bool good = true;
    while (good && size > 0) {
        const size_t room = piece - p->text % piece;
        const size_t count = size < room ? size : room;
        const bool flush = count == room || (!p->steady && count == size);
        good = compress(p, text, count, flush ? ZSTD_e_flush : ZSTD_e_continue);
        text += count;
        size -= count;
        p->open = true;
        p->text += count;
        if (good && p->text == JOURNAL_PACK_FRAME)
            good = end_frame(p);
    }
    return good;
}

/* Returns what was packed. After a failure the next piece begins a frame of its own. */
static const void *finish_pack(packer *p, size_t *packed, bool good)
{
    *packed = p->used;
    if (good)
        return p->bytes;
    p->anew = true;
    errno = ENOMEM;
    return NULL;
}

/* Packs records for the spool; what is returned is good up to the next call. */
static const void *pack(void *user, size_t *packed, const void *records, size_t size)
{
    packer *p = user;
    p->used = 0;
    if (p->anew)
        begin_anew(p);
    return finish_pack(p, packed, pack_pieces(p, records, size));
}

/* The spool has written what was packed, or has not: then the next text needs a frame of its
 * own. */
static void settle(void *user, bool written)
{
    packer *p = user;
    if (written)
        p->settled = p->open;
    p->anew = !written;
}

/* Ends the frame of the packer, so that all records before it can be read. */
static const void *end_pack(void *user, size_t *packed)
{
    packer *p = user;
    p->used = 0;
    if (p->anew)
        begin_anew(p);
    return finish_pack(p, packed, !p->open || end_frame(p));
}

static void begin_pack(void *user)
{
    packer *p = user;
    p->settled = false;
    p->anew = true;
}

/* The spool calls it when its thread has ended. */
static void free_packer(void *user)
{
    packer *p = user;
    (void)ZSTD_freeCCtx(p->zstd);
    free(p->bytes);
    free(p);
}

/* Lets zstd take its memory, by packing something. */
static bool prepare(packer *p)
{
    return p->zstd &&
           !ZSTD_isError(ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_compressionLevel, LEVEL)) &&
           !ZSTD_isError(ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_windowLog, WINDOW_LOG)) &&
           reserve(p, ROOM) && compress(p, "", 1, ZSTD_e_flush);
}

bool journal_packer(spool_packer *out, bool steady)
{
    packer *p = calloc(1, sizeof *p);
    if (!p)
        return false;
    p->steady = steady;
    p->zstd = ZSTD_createCCtx();
    if (!prepare(p)) {
        free_packer(p);
        return false;
    }
    begin_pack(p);
    *out = (spool_packer){.user = p, .pack = pack, .settle = settle, .end = end_pack,
                          .begin = begin_pack, .free = free_packer};
    return true;
}

/* ---- Unpacking ------------------------------------------------------------------------------- */

struct journal_unpacker {
    int fd;
    ZSTD_DCtx *zstd; /* NULL: the file is not packed */
    size_t wanted;   /* bytes that zstd wants next, so that it unpacks block by block */
    bool holds;      /* zstd may have more text */
    bool begun;      /* the first bytes have been read */
    bool at_end;     /* of the file */
    size_t first;    /* of the bytes that wait */
    size_t end;
    uint64_t place;  /* of the first one in the file */
    char bytes[READ_BYTES];
};

static const char magic[] = {0x28, '\xB5', 0x2F, '\xFD'}; /* of a frame */

journal_unpacker *journal_unpack(int fd)
{
    journal_unpacker *u = calloc(1, sizeof *u);
    if (u)
        u->fd = fd;
    return u;
}

void journal_unpack_end(journal_unpacker *u)
{
    if (!u)
        return;
    (void)ZSTD_freeDCtx(u->zstd);
    free(u);
}

static size_t waiting(const journal_unpacker *u)
{
    return u->end - u->first;
}

static void use(journal_unpacker *u, size_t count)
{
    u->first += count;
    u->place += count;
}

/* Reads until so many bytes wait, or the file ends. Returns false after an error. */
static bool fill_to(journal_unpacker *u, size_t count)
{
    if (waiting(u) >= count)
        return true;
    memmove(u->bytes, u->bytes + u->first, waiting(u));
    u->end -= u->first;
    u->first = 0;
    while (waiting(u) < count && !u->at_end) {
        ssize_t got = read(u->fd, u->bytes + u->end, sizeof u->bytes - u->end);
        if (got < 0 && errno != EINTR)
            return false;
        u->end += got > 0 ? (size_t)got : 0;
        u->at_end = got == 0;
    }
    return true;
}

/* Looks at the first bytes. Returns false with an errno. */
static bool begin_unpack(journal_unpacker *u)
{
    if (u->begun)
        return true;
    if (!fill_to(u, sizeof magic))
        return false;
    if (u->end >= sizeof magic && memcmp(u->bytes, magic, sizeof magic) == 0) {
        u->zstd = ZSTD_createDCtx();
        if (!u->zstd) {
            errno = ENOMEM;
            return false;
        }
        u->wanted = ZSTD_initDStream(u->zstd);
    }
    u->begun = true;
    return true;
}

/* Unpacks at most a block of the bytes that wait. Returns how many bytes of text it gives, or what
 * is an error for ZSTD_isError(). */
static size_t decompress(journal_unpacker *u, void *text, size_t size)
{
    const size_t count = waiting(u) < u->wanted ? waiting(u) : u->wanted;
    ZSTD_inBuffer in = {u->bytes + u->first, count, 0};
    ZSTD_outBuffer out = {text, size, 0};
    const size_t next = ZSTD_decompressStream(u->zstd, &out, &in);
    if (ZSTD_isError(next))
        return next;
    use(u, in.pos);
    u->holds = out.pos == size;
    u->wanted = next > 0 ? next : ZSTD_initDStream(u->zstd);
    return out.pos;
}

/* Reads unpacked text. Returns 0 at the end and -1 with a problem, which may be damage of the
 * file. */
static ssize_t read_packed(journal_unpacker *u, void *text, size_t size, const char **problem,
                           bool *damaged)
{
    size_t count = 0;
    while (count == 0) {
        if (!u->holds && !fill_to(u, 1)) {
            *problem = strerror(errno);
            return -1;
        }
        if (!u->holds && waiting(u) == 0)
            return 0;
        count = decompress(u, text, size);
    }
    if (!ZSTD_isError(count))
        return (ssize_t)count;
    *problem = ZSTD_getErrorName(count);
    *damaged = true;
    return -1;
}

ssize_t journal_unpack_read(journal_unpacker *u, void *text, size_t size, const char **problem,
                            bool *damaged)
{
    *damaged = false;
    if (!begin_unpack(u) || (!u->zstd && !fill_to(u, 1))) {
        *problem = strerror(errno);
        return -1;
    }
    if (u->zstd)
        return read_packed(u, text, size, problem, damaged);
    const size_t count = waiting(u) < size ? waiting(u) : size;
    memcpy(text, u->bytes + u->first, count);
    use(u, count);
    return (ssize_t)count;
}

bool journal_unpack_go_on(journal_unpacker *u)
{
    const char *found = NULL;
    use(u, waiting(u) > 0);
    while (!found && fill_to(u, sizeof magic) && waiting(u) >= sizeof magic) {
        found = memmem(u->bytes + u->first, waiting(u), magic, sizeof magic);
        use(u, found ? (size_t)(found - u->bytes) - u->first : waiting(u) - (sizeof magic - 1));
    }
    u->wanted = ZSTD_initDStream(u->zstd);
    u->holds = false;
    return found != NULL;
}

bool journal_is_packed(const journal_unpacker *u)
{
    return u->zstd != NULL;
}

uint64_t journal_unpack_place(const journal_unpacker *u)
{
    return u->place;
}

size_t journal_pack_last_frame(const char *bytes, size_t size)
{
    for (size_t i = size; i-- > 0;)
        if (size - i >= sizeof magic && memcmp(bytes + i, magic, sizeof magic) == 0)
            return i;
    return SIZE_MAX;
}
