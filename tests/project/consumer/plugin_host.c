// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Loads a plug-in, calls it from a thread, unloads it, and ends the thread afterwards: threads of
// the library must not run code that is no longer there.
//
//     plugin_host PLUGIN

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

static pthread_barrier_t barrier;
static void *plugin;
static int result = 1;

static void *work(void *context)
{
    int (*run)(void);
    void *symbol = dlsym(plugin, "plugin_run");
    (void)context;
    if (symbol) {
        memcpy(&run, &symbol, sizeof run);
        result = run();
    }
    pthread_barrier_wait(&barrier); // the main thread unloads the plug-in
    pthread_barrier_wait(&barrier);
    return NULL;
}

int main(int argc, char **argv)
{
    pthread_t thread;
    plugin = argc == 2 ? dlopen(argv[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!plugin) {
        puts("the plug-in cannot be loaded");
        return 1;
    }
    if (pthread_barrier_init(&barrier, NULL, 2) || pthread_create(&thread, NULL, work, NULL))
        return 1;
    pthread_barrier_wait(&barrier);
    if (dlclose(plugin))
        return 1;
    pthread_barrier_wait(&barrier);
    if (pthread_join(thread, NULL))
        return 1;
    puts("the plug-in was unloaded");
    return result;
}
