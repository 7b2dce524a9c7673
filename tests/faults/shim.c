/* Calls of the system that fail when asked to: preloaded (LD_PRELOAD), so that calls of libraries are seen as well.
 *
 * A call counts that names a file below the root, or works on one opened there; of mmap and fork each one of the main
 * thread (Python waits for ever for a thread that finds no memory as it starts). Nothing happens before faults_arm().
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
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

enum { OPEN, READ, WRITE, CLOSE, RENAME, SYNC, MKDIR, UNLINK, CHMOD, MMAP, FORK, KINDS };
enum { FAIL, SHORT, KILL, KILL_AFTER_HALF };
#define HANDLES 1024
#define LOGGED 20000
#define NAMED 160

static char root[PATH_MAX];
static size_t root_length;
static char watched[HANDLES];
static atomic_long calls;
static long chosen;           /* the call that fails, from 1; 0 for none */
static int error, how;
static unsigned lasting;      /* kinds of calls that fail from the chosen one on, as bits */
static atomic_int armed, hits;
static struct { char kind; char name[NAMED]; } seen[LOGGED];

void faults_arm(const char *folder, long which, int number, int kind_of_fault, unsigned from_then_on)
{
    snprintf(root, sizeof root, "%s", folder);
    root_length = strlen(root);
    chosen = which;
    error = number;
    how = kind_of_fault;
    lasting = from_then_on;
    calls = 0;
    hits = 0;
    armed = 1;
}
void faults_disarm(void) { armed = 0; }
void faults_watch(int handle) { if (handle >= 0 && handle < HANDLES) watched[handle] = 1; }
long faults_calls(void) { return calls; }
int faults_hits(void) { return hits; }
int faults_kind(long call) { return seen[call - 1].kind; }
const char *faults_name(long call) { return seen[call - 1].name; }

static int inside(const char *path)
{
    if (!armed || !path) return 0;
    if (path[0] != '/') return 1; /* the working folder is below the root */
    return strncmp(path, root, root_length) == 0 && (path[root_length] == '/' || path[root_length] == 0);
}
static int in_main(void) { return armed && gettid() == getpid(); }
static int on(int handle) { return armed && handle >= 0 && handle < HANDLES && watched[handle]; }

/* Whether this call fails: 0 no, 1 yes (errno is set), 2 it does half. */
static int struck(int kind, const char *name)
{
    long call = atomic_fetch_add(&calls, 1) + 1;
    if (call <= LOGGED) {
        seen[call - 1].kind = (char)kind;
        snprintf(seen[call - 1].name, NAMED, "%s", name ? name : "");
    }
    if (call == chosen || (chosen && call > chosen && (lasting >> kind & 1))) {
        hits++;
        if (how == KILL) kill(getpid(), SIGKILL);
        if (how == SHORT || how == KILL_AFTER_HALF) return 2;
        errno = error;
        return 1;
    }
    return 0;
}
static const char *name_of(int handle, char *text)
{
    char link[40];
    snprintf(link, sizeof link, "/proc/self/fd/%d", handle);
    ssize_t n = readlink(link, text, PATH_MAX - 1);
    text[n > 0 ? n : 0] = 0;
    return text;
}
static int struck_on(int kind, int handle)
{
    char text[PATH_MAX];
    int before = errno, found;
    name_of(handle, text);
    errno = before;
    found = struck(kind, text);
    return found;
}

#define REAL(type, name, ...) \
    static type (*real)(__VA_ARGS__); \
    if (!real) real = (type (*)(__VA_ARGS__))dlsym(RTLD_NEXT, #name)
#define MODE(last) mode_t mode = 0; if (flags & (O_CREAT | O_TMPFILE)) { va_list a; va_start(a, last); \
    mode = va_arg(a, mode_t); va_end(a); }
#define OPENED(handle) do { int h = (handle); if (h >= 0 && h < HANDLES) watched[h] = (char)counts; return h; } while (0)

int open(const char *path, int flags, ...)
{
    REAL(int, open, const char *, int, ...); MODE(flags)
    int counts = inside(path);
    if (counts && struck(OPEN, path) == 1) return -1;
    OPENED(real(path, flags, mode));
}
int open64(const char *path, int flags, ...)
{
    REAL(int, open64, const char *, int, ...); MODE(flags)
    int counts = inside(path);
    if (counts && struck(OPEN, path) == 1) return -1;
    OPENED(real(path, flags, mode));
}
int openat(int at, const char *path, int flags, ...)
{
    REAL(int, openat, int, const char *, int, ...); MODE(flags)
    int counts = inside(path);
    if (counts && struck(OPEN, path) == 1) return -1;
    OPENED(real(at, path, flags, mode));
}
FILE *fopen(const char *path, const char *mode)
{
    REAL(FILE *, fopen, const char *, const char *);
    return inside(path) && struck(OPEN, path) == 1 ? NULL : real(path, mode);
}
FILE *fopen64(const char *path, const char *mode)
{
    REAL(FILE *, fopen64, const char *, const char *);
    return inside(path) && struck(OPEN, path) == 1 ? NULL : real(path, mode);
}

#define MOVED(kind, type, name, declared, given, size) \
    ssize_t name declared \
    { \
        static ssize_t (*real) declared; \
        if (!real) real = (ssize_t (*) declared)dlsym(RTLD_NEXT, #name); \
        int what = on(handle) ? struck_on(kind, handle) : 0; \
        if (what == 1) return -1; \
        if (what == 2 && size > 1) size = size / 2; \
        if (what == 2 && how == KILL_AFTER_HALF) { \
            (void)!real given; \
            kill(getpid(), SIGKILL); \
        } \
        return real given; \
    }
MOVED(READ, ssize_t, read, (int handle, void *to, size_t size), (handle, to, size), size)
MOVED(WRITE, ssize_t, write, (int handle, const void *from, size_t size), (handle, from, size), size)
MOVED(READ, ssize_t, pread, (int handle, void *to, size_t size, off_t at), (handle, to, size, at), size)
MOVED(READ, ssize_t, pread64, (int handle, void *to, size_t size, off64_t at), (handle, to, size, at), size)
MOVED(WRITE, ssize_t, pwrite, (int handle, const void *from, size_t size, off_t at), (handle, from, size, at), size)
MOVED(WRITE, ssize_t, pwrite64, (int handle, const void *from, size_t size, off64_t at), (handle, from, size, at), size)

int close(int handle)
{
    REAL(int, close, int);
    int what = on(handle) ? struck_on(CLOSE, handle) : 0, before = errno;
    if (handle >= 0 && handle < HANDLES) watched[handle] = 0;
    int done = real(handle); /* Linux closes it in any case */
    if (what != 1) return done;
    errno = before;
    return -1;
}

int dup2(int handle, int other)
{
    REAL(int, dup2, int, int);
    int done = real(handle, other);
    if (done >= 0 && done < HANDLES) watched[done] = handle >= 0 && handle < HANDLES && watched[handle];
    return done;
}

#define PLAIN(kind, name, declared, given, counts, named) \
    int name declared \
    { \
        static int (*real) declared; \
        if (!real) real = (int (*) declared)dlsym(RTLD_NEXT, #name); \
        if ((counts) && (named) == 1) return -1; \
        return real given; \
    }
PLAIN(RENAME, rename, (const char *from, const char *to), (from, to), inside(to), struck(RENAME, to))
PLAIN(RENAME, renameat, (int a, const char *from, int b, const char *to), (a, from, b, to), inside(to), struck(RENAME, to))
PLAIN(SYNC, fsync, (int handle), (handle), on(handle), struck_on(SYNC, handle))
PLAIN(SYNC, fdatasync, (int handle), (handle), on(handle), struck_on(SYNC, handle))
PLAIN(MKDIR, mkdir, (const char *path, mode_t mode), (path, mode), inside(path), struck(MKDIR, path))
PLAIN(UNLINK, unlink, (const char *path), (path), inside(path), struck(UNLINK, path))
PLAIN(UNLINK, unlinkat, (int at, const char *path, int flags), (at, path, flags), inside(path), struck(UNLINK, path))
PLAIN(UNLINK, rmdir, (const char *path), (path), inside(path), struck(UNLINK, path))
PLAIN(CHMOD, chmod, (const char *path, mode_t mode), (path, mode), inside(path), struck(CHMOD, path))
PLAIN(CHMOD, fchmod, (int handle, mode_t mode), (handle, mode), on(handle), struck_on(CHMOD, handle))

#define MAPS(name, offset) \
    void *name(void *at, size_t size, int access, int flags, int handle, offset start) \
    { \
        static void *(*real)(void *, size_t, int, int, int, offset); \
        if (!real) real = (void *(*)(void *, size_t, int, int, int, offset))dlsym(RTLD_NEXT, #name); \
        if (in_main() && struck(MMAP, "") == 1) return MAP_FAILED; \
        return real(at, size, access, flags, handle, start); \
    }
MAPS(mmap, off_t)
MAPS(mmap64, off64_t)

pid_t fork(void)
{
    REAL(pid_t, fork, void);
    return in_main() && struck(FORK, "") == 1 ? -1 : real();
}
/* A child of vfork would return through the frame of this function; fork does what its callers need. */
pid_t vfork(void) { return fork(); }
