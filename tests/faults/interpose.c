/* Counts the calls by which a process changes files under one folder, and disturbs one of them.
 *
 * Built by injection.py and loaded with LD_PRELOAD, so that it also sees what Arrow, OpenEXR,
 * SQLite, safetensors and Blender write from compiled code. The plan and the counters are in a
 * file that is mapped by all processes of a run; injection.py has the same layout.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define MOST_CALLS 65536

enum kind { NONE, CRASH_BEFORE, CRASH_AFTER, TORN, FULL, IO_ERROR, INTERRUPTED };

struct plan {
    char root[PATH_MAX];        /* only calls under this folder count; empty: none */
    _Atomic long calls;         /* so many until now */
    _Atomic long bytes;         /* written by them */
    long at;                    /* the call to disturb, from 0 */
    int kind;                   /* how */
    _Atomic int fired;          /* whether it came to that */
    char where[PATH_MAX];       /* path of the disturbed call */
    char operations[MOST_CALLS]; /* one letter for each call */
};

static struct plan *plan;

__attribute__((constructor)) static void map_plan(void)
{
    const char *path = getenv("PLIANT_FAULT_PLAN");
    int descriptor = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    if (descriptor < 0)
        return;
    void *found = mmap(NULL, sizeof *plan, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    close(descriptor);
    if (found != MAP_FAILED)
        plan = found;
}

static int name_of(int descriptor, char *name)
{
    char link[64];
    snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
    ssize_t size = readlink(link, name, PATH_MAX - 1);
    if (size < 0)
        return 0;
    name[size] = 0;
    return 1;
}

static int absolute(int folder, const char *path, char *name)
{
    char start[PATH_MAX];
    if (path[0] == '/')
        return snprintf(name, PATH_MAX, "%s", path) < PATH_MAX;
    if (folder == AT_FDCWD ? getcwd(start, sizeof start) == NULL : !name_of(folder, start))
        return 0;
    return snprintf(name, PATH_MAX, "%s/%s", start, path) < PATH_MAX;
}

static int consumes(char operation)
{
    return strchr("womta", operation) != NULL; /* write, open, mkdir, truncate, allocate */
}

/* Returns how to disturb a call; the errno kinds have set errno. */
static enum kind disturbed(char operation, const char *name)
{
    size_t length = strlen(plan->root);
    if (!length || strncmp(name, plan->root, length) || (name[length] != '/' && name[length]))
        return NONE;
    long number = atomic_fetch_add(&plan->calls, 1);
    if (number < MOST_CALLS)
        plan->operations[number] = operation;
    enum kind kind = plan->kind;
    if (number != plan->at) { /* a full disk stays full */
        if (kind != FULL || !plan->fired || number < plan->at || !consumes(operation))
            return NONE;
        errno = ENOSPC;
        return IO_ERROR;
    }
    plan->fired = 1;
    snprintf(plan->where, sizeof plan->where, "%s", name);
    errno = kind == FULL ? ENOSPC : kind == IO_ERROR ? EIO : EINTR;
    if (kind == CRASH_BEFORE || (kind == TORN && operation != 'w'))
        kill(0, SIGKILL);
    return kind;
}

static enum kind of_descriptor(char operation, int descriptor)
{
    char name[PATH_MAX];
    int before = errno;
    enum kind kind = NONE;
    if (plan && plan->root[0] && name_of(descriptor, name)) {
        errno = before;
        kind = disturbed(operation, name);
    }
    if (kind == NONE)
        errno = before;
    return kind;
}

static enum kind of_path(char operation, int folder, const char *path)
{
    char name[PATH_MAX];
    int before = errno;
    enum kind kind = NONE;
    if (plan && plan->root[0] && path && absolute(folder, path, name))
        kind = disturbed(operation, name);
    if (kind == NONE)
        errno = before;
    return kind;
}

static int fails(enum kind kind)
{
    return kind == FULL || kind == IO_ERROR || kind == INTERRUPTED;
}

#define REAL(name) ((__typeof__(&name))real(#name))
static void *real(const char *name)
{
    return dlsym(RTLD_NEXT, name);
}

/* A call without data: fails, or is done, perhaps as the last deed of the process. */
#define SIMPLE(decision, failed, call)                                                            \
    do {                                                                                           \
        enum kind kind_ = (decision);                                                              \
        if (fails(kind_))                                                                          \
            return failed;                                                                         \
        __typeof__(call) result_ = (call);                                                         \
        if (kind_ == CRASH_AFTER)                                                                  \
            kill(0, SIGKILL);                                                                      \
        return result_;                                                                            \
    } while (0)

/* A call that writes `size` bytes: `part` writes half of them. A disk that gets full takes half. */
#define DATA(descriptor, size, call, part)                                                         \
    do {                                                                                           \
        enum kind kind_ = of_descriptor('w', descriptor);                                          \
        if (kind_ == IO_ERROR || kind_ == INTERRUPTED || (kind_ == FULL && (size) < 2))            \
            return -1;                                                                             \
        ssize_t result_ = kind_ == TORN || kind_ == FULL ? (part) : (call);                        \
        if (kind_ == TORN || kind_ == CRASH_AFTER)                                                 \
            kill(0, SIGKILL);                                                                      \
        if (plan && kind_ == NONE && result_ > 0 && plan->root[0])                                 \
            count_bytes(descriptor, result_);                                                      \
        return result_;                                                                            \
    } while (0)

static void count_bytes(int descriptor, ssize_t size)
{
    char name[PATH_MAX];
    if (name_of(descriptor, name) && !strncmp(name, plan->root, strlen(plan->root)))
        plan->bytes += size;
}

ssize_t write(int d, const void *data, size_t size)
{
    DATA(d, size, REAL(write)(d, data, size), REAL(write)(d, data, size / 2));
}
ssize_t pwrite(int d, const void *data, size_t size, off_t at)
{
    DATA(d, size, REAL(pwrite)(d, data, size, at), REAL(pwrite)(d, data, size / 2, at));
}
ssize_t pwrite64(int d, const void *data, size_t size, off64_t at)
{
    DATA(d, size, REAL(pwrite64)(d, data, size, at), REAL(pwrite64)(d, data, size / 2, at));
}
static size_t first(const struct iovec *parts, int count)
{
    return count > 0 ? parts[0].iov_len : 0;
}
ssize_t writev(int d, const struct iovec *parts, int count)
{
    DATA(d, first(parts, count), REAL(writev)(d, parts, count),
         REAL(write)(d, parts[0].iov_base, parts[0].iov_len / 2));
}
ssize_t sendfile(int d, int from, off_t *at, size_t size)
{
    ssize_t (*original)(int, int, off_t *, size_t) = real("sendfile");
    DATA(d, size, original(d, from, at, size), original(d, from, at, 1));
}
ssize_t sendfile64(int d, int from, off64_t *at, size_t size)
{
    ssize_t (*original)(int, int, off64_t *, size_t) = real("sendfile64");
    DATA(d, size, original(d, from, at, size), original(d, from, at, 1));
}
ssize_t copy_file_range(int from, off64_t *a, int d, off64_t *b, size_t size, unsigned flags)
{
    DATA(d, size, REAL(copy_file_range)(from, a, d, b, size, flags),
         REAL(copy_file_range)(from, a, d, b, 1, flags));
}

static int changes(int flags)
{
    return flags & (O_CREAT | O_TRUNC);
}
#define MODE                                                                                       \
    mode_t mode = 0;                                                                               \
    if (flags & (O_CREAT | O_TMPFILE)) {                                                           \
        va_list rest;                                                                              \
        va_start(rest, flags);                                                                     \
        mode = va_arg(rest, mode_t);                                                               \
        va_end(rest);                                                                              \
    }
#define OPEN(folder, path, call) SIMPLE(changes(flags) ? of_path('o', folder, path) : NONE, -1, call)

int open(const char *path, int flags, ...)
{
    MODE OPEN(AT_FDCWD, path, REAL(open)(path, flags, mode));
}
int open64(const char *path, int flags, ...)
{
    MODE OPEN(AT_FDCWD, path, REAL(open64)(path, flags, mode));
}
int openat(int folder, const char *path, int flags, ...)
{
    MODE OPEN(folder, path, REAL(openat)(folder, path, flags, mode));
}
int openat64(int folder, const char *path, int flags, ...)
{
    MODE OPEN(folder, path, REAL(openat64)(folder, path, flags, mode));
}
int creat(const char *path, mode_t mode)
{
    SIMPLE(of_path('o', AT_FDCWD, path), -1, REAL(creat)(path, mode));
}
int creat64(const char *path, mode_t mode)
{
    SIMPLE(of_path('o', AT_FDCWD, path), -1, REAL(creat64)(path, mode));
}
static enum kind of_stream(const char *path, const char *mode)
{
    return mode[0] == 'r' ? NONE : of_path('o', AT_FDCWD, path);
}
FILE *fopen(const char *path, const char *mode)
{
    SIMPLE(of_stream(path, mode), NULL, REAL(fopen)(path, mode));
}
FILE *fopen64(const char *path, const char *mode)
{
    SIMPLE(of_stream(path, mode), NULL, REAL(fopen64)(path, mode));
}

int fsync(int d)
{
    SIMPLE(of_descriptor('s', d), -1, REAL(fsync)(d));
}
int fdatasync(int d)
{
    SIMPLE(of_descriptor('s', d), -1, REAL(fdatasync)(d));
}
int ftruncate(int d, off_t size)
{
    SIMPLE(of_descriptor('t', d), -1, REAL(ftruncate)(d, size));
}
int ftruncate64(int d, off64_t size)
{
    SIMPLE(of_descriptor('t', d), -1, REAL(ftruncate64)(d, size));
}
int truncate(const char *path, off_t size)
{
    SIMPLE(of_path('t', AT_FDCWD, path), -1, REAL(truncate)(path, size));
}
int fallocate(int d, int mode, off_t at, off_t size)
{
    SIMPLE(of_descriptor('a', d), -1, REAL(fallocate)(d, mode, at, size));
}
int posix_fallocate(int d, off_t at, off_t size)
{
    SIMPLE(of_descriptor('a', d), errno, REAL(posix_fallocate)(d, at, size));
}
int posix_fallocate64(int d, off64_t at, off64_t size)
{
    SIMPLE(of_descriptor('a', d), errno, REAL(posix_fallocate64)(d, at, size));
}

int mkdir(const char *path, mode_t mode)
{
    SIMPLE(of_path('m', AT_FDCWD, path), -1, REAL(mkdir)(path, mode));
}
int mkdirat(int folder, const char *path, mode_t mode)
{
    SIMPLE(of_path('m', folder, path), -1, REAL(mkdirat)(folder, path, mode));
}
int rename(const char *from, const char *to)
{
    SIMPLE(of_path('r', AT_FDCWD, to), -1, REAL(rename)(from, to));
}
int renameat(int a, const char *from, int b, const char *to)
{
    SIMPLE(of_path('r', b, to), -1, REAL(renameat)(a, from, b, to));
}
int renameat2(int a, const char *from, int b, const char *to, unsigned flags)
{
    SIMPLE(of_path('r', b, to), -1, REAL(renameat2)(a, from, b, to, flags));
}
int link(const char *from, const char *to)
{
    SIMPLE(of_path('m', AT_FDCWD, to), -1, REAL(link)(from, to));
}
int symlink(const char *from, const char *to)
{
    SIMPLE(of_path('m', AT_FDCWD, to), -1, REAL(symlink)(from, to));
}
int unlink(const char *path)
{
    SIMPLE(of_path('u', AT_FDCWD, path), -1, REAL(unlink)(path));
}
int unlinkat(int folder, const char *path, int flags)
{
    SIMPLE(of_path('u', folder, path), -1, REAL(unlinkat)(folder, path, flags));
}
int rmdir(const char *path)
{
    SIMPLE(of_path('u', AT_FDCWD, path), -1, REAL(rmdir)(path));
}
int remove(const char *path)
{
    SIMPLE(of_path('u', AT_FDCWD, path), -1, REAL(remove)(path));
}
