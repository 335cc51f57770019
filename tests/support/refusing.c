/* Refuses the Nth large allocation, write or read of a process: cc -shared -fPIC -o refusing.so refusing.c -ldl
   KAJU_REFUSE is "memory N", "write N" or "read N"; of files only those whose path holds KAJU_BELOW count.
   When it refuses it makes the file KAJU_REFUSED. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int left = -1;
static char what = 0;
static const char *below = 0;
#define LARGE (1 << 18)

__attribute__((constructor)) static void begin(void) {
  const char *told = getenv("KAJU_REFUSE");
  below = getenv("KAJU_BELOW");
  if (told && strchr(told, ' ')) { what = told[0]; left = atoi(strchr(told, ' ') + 1); }
}

static int now(char kind) {
  if (what != kind || left < 0 || __sync_sub_and_fetch(&left, 1) != -1) return 0;
  close(open(getenv("KAJU_REFUSED"), O_CREAT | O_WRONLY, 0600));
  return 1;
}

static int counts(int file) {
  char link[64], path[4096];
  snprintf(link, sizeof link, "/proc/self/fd/%d", file);
  ssize_t n = readlink(link, path, sizeof path - 1);
  if (n <= 0 || !below) return 0;
  path[n] = 0;
  return strstr(path, below) != 0;
}

void *malloc(size_t size) {
  static void *(*real)(size_t) = 0;
  if (!real) real = dlsym(RTLD_NEXT, "malloc");
  if (size >= LARGE && now('m')) { errno = ENOMEM; return 0; }
  return real(size);
}

void *realloc(void *old, size_t size) {
  static void *(*real)(void *, size_t) = 0;
  if (!real) real = dlsym(RTLD_NEXT, "realloc");
  if (size >= LARGE && now('m')) { errno = ENOMEM; return 0; }
  return real(old, size);
}

ssize_t write(int file, const void *data, size_t size) {
  static ssize_t (*real)(int, const void *, size_t) = 0;
  if (!real) real = dlsym(RTLD_NEXT, "write");
  if (what == 'w' && counts(file) && now('w')) { errno = ENOSPC; return -1; }
  return real(file, data, size);
}

ssize_t read(int file, void *data, size_t size) {
  static ssize_t (*real)(int, void *, size_t) = 0;
  if (!real) real = dlsym(RTLD_NEXT, "read");
  if (what == 'r' && counts(file) && now('r')) return 0; /* the file ends here */
  return real(file, data, size);
}
