/* Records what a process asks of the disk below $POWER_CUT_ROOT in the file $POWER_CUT_LOG, as a library for LD_PRELOAD.

   A record is a line "KIND INODE LENGTH PATH\tPATH", then LENGTH bytes:
     C  a file was created               S  the bytes of a file were synced: the bytes
     D  a folder was created             F  the names in a folder were synced
     R  the first path was renamed to the second            U  a name was removed
   `power_cuts.py` plays them. Writes are not recorded: those that are not synced are forgotten. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER; /* one action and its record at a time */
static int output = -1;
static const char *root;

__attribute__((constructor)) static void begin(void) {
  root = getenv("POWER_CUT_ROOT");
  const char *path = getenv("POWER_CUT_LOG");
  int (*real)(const char *, int, ...) = dlsym(RTLD_NEXT, "open64");
  if (root && path) output = real(path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0600);
}

#define REAL(name) __typeof__(&name) real = (__typeof__(&name))dlsym(RTLD_NEXT, #name)

static void fail(const char *what) {
  perror(what);
  abort();
}

/* The absolute path; empty for one that is not below the root. */
static void resolve(int folder, const char *path, char *found) {
  char link[64];
  found[0] = 0;
  if (output < 0) return;
  if (path[0] == '/') {
    snprintf(found, PATH_MAX, "%s", path);
  } else {
    snprintf(link, sizeof link, folder == AT_FDCWD ? "/proc/self/cwd" : "/proc/self/fd/%d", folder);
    ssize_t length = readlink(link, found, PATH_MAX - 1);
    if (length < 0) fail("readlink");
    if (path[0]) snprintf(found + length, PATH_MAX - length, "/%s", path);
    else found[length] = 0;
  }
  size_t length = strlen(root);
  if (strncmp(found, root, length) || (found[length] && found[length] != '/')) found[0] = 0;
}

static void record(char kind, ino_t inode, const char *first, const char *second, void *data, size_t size) {
  char head[2 * PATH_MAX + 64];
  int length = snprintf(head, sizeof head, "%c %lu %zu %s\t%s\n", kind, (unsigned long)inode, size, first, second);
  struct iovec parts[2] = {{head, length}, {data, size}};
  if (writev(output, parts, 2) != (ssize_t)(length + size)) fail("the record of a power cut");
}

static int open_at(int folder, const char *path, int flags, mode_t mode) {
  REAL(openat64);
  char name[PATH_MAX];
  struct stat found;
  if (!(flags & O_CREAT) || (resolve(folder, path, name), !name[0])) return real(folder, path, flags, mode);
  pthread_mutex_lock(&lock);
  int is_new = lstat(name, &found) != 0;
  int opened = real(folder, path, flags, mode), code = errno;
  if (opened >= 0 && is_new && fstat(opened, &found) == 0) record('C', found.st_ino, name, "", NULL, 0);
  pthread_mutex_unlock(&lock);
  errno = code;
  return opened;
}

#define OPEN(name, parameters, folder)                                             \
  int name parameters {                                                            \
    va_list rest;                                                                  \
    va_start(rest, flags);                                                         \
    mode_t mode = flags & (O_CREAT | __O_TMPFILE) ? va_arg(rest, mode_t) : 0;      \
    va_end(rest);                                                                  \
    return open_at(folder, path, flags, mode);                                     \
  }
OPEN(open, (const char *path, int flags, ...), AT_FDCWD)
OPEN(open64, (const char *path, int flags, ...), AT_FDCWD)
OPEN(openat, (int folder, const char *path, int flags, ...), folder)
OPEN(openat64, (int folder, const char *path, int flags, ...), folder)

static int synchronize(int file, int (*real)(int)) {
  char name[PATH_MAX];
  struct stat found;
  char *data = NULL;
  ssize_t size = 0;
  resolve(file, "", name);
  if (!name[0]) return real(file);
  pthread_mutex_lock(&lock);
  if (fstat(file, &found)) fail("fstat");
  if (S_ISREG(found.st_mode)) { /* the bytes before the call: later ones may not be synced */
    int (*real_open)(const char *, int, ...) = dlsym(RTLD_NEXT, "open64");
    int readable = file; /* SQLite's: closing another descriptor of that file would release its locks */
    if ((fcntl(file, F_GETFL) & O_ACCMODE) == O_WRONLY) readable = real_open(name, O_RDONLY | O_CLOEXEC);
    data = malloc(found.st_size + 1);
    if (readable < 0 || !data || (size = pread(readable, data, found.st_size, 0)) < 0) fail("a synced file");
    if (readable != file) close(readable);
  }
  int result = real(file), code = errno;
  if (result == 0) record(S_ISREG(found.st_mode) ? 'S' : 'F', found.st_ino, name, "", data, size);
  pthread_mutex_unlock(&lock);
  free(data);
  errno = code;
  return result;
}
int fsync(int file) { REAL(fsync); return synchronize(file, real); }
int fdatasync(int file) { REAL(fdatasync); return synchronize(file, real); }

#define CHANGE(kind, folder, path, other, target, call)                \
  char name[PATH_MAX], second[PATH_MAX] = "";                          \
  struct stat found = {0};                                             \
  resolve(folder, path, name);                                         \
  if (target) resolve(other, target, second);                          \
  if (!name[0]) return call;                                           \
  pthread_mutex_lock(&lock);                                           \
  lstat(name, &found);                                                 \
  int result = call, code = errno;                                     \
  if (result == 0) record(kind, found.st_ino, name, second, NULL, 0);  \
  pthread_mutex_unlock(&lock);                                         \
  errno = code;                                                        \
  return result;

#define NONE ((const char *)NULL)

int rename(const char *path, const char *to) {
  REAL(rename);
  CHANGE('R', AT_FDCWD, path, AT_FDCWD, to, real(path, to))
}
int renameat(int folder, const char *path, int other, const char *to) {
  REAL(renameat);
  CHANGE('R', folder, path, other, to, real(folder, path, other, to))
}
int unlink(const char *path) {
  REAL(unlink);
  CHANGE('U', AT_FDCWD, path, AT_FDCWD, NONE, real(path))
}
int unlinkat(int folder, const char *path, int flags) {
  REAL(unlinkat);
  CHANGE('U', folder, path, AT_FDCWD, NONE, real(folder, path, flags))
}
int rmdir(const char *path) {
  REAL(rmdir);
  CHANGE('U', AT_FDCWD, path, AT_FDCWD, NONE, real(path))
}
int mkdir(const char *path, mode_t mode) {
  REAL(mkdir);
  CHANGE('D', AT_FDCWD, path, AT_FDCWD, NONE, real(path, mode))
}
int mkdirat(int folder, const char *path, mode_t mode) {
  REAL(mkdirat);
  CHANGE('D', folder, path, AT_FDCWD, NONE, real(folder, path, mode))
}
