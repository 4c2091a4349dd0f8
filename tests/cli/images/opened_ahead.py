# SPDX-FileCopyrightText: 2026 The sparegs authors
# SPDX-License-Identifier: Apache-2.0

"""Runs a command that evaluates images one after the other, and succeeds if it opens images ahead.

    opened_ahead.py IMAGES SAVED COMMAND...

IMAGES holds NAME.EXT, the command writes NAME.png to the folder SAVED when it has evaluated the image NAME. The order of
both is that of the kernel's events (inotify). Between two saved images, an image that is not the next one must be opened.
"""
import ctypes
import os
import struct
import subprocess
import sys

IN_OPEN, IN_MOVED_TO, IN_NONBLOCK = 0x20, 0x80, 0o4000
images, saved, command = sys.argv[1], sys.argv[2], sys.argv[3:]
libc = ctypes.CDLL(None)
events = libc.inotify_init1(IN_NONBLOCK)
watched = libc.inotify_add_watch(events, os.fsencode(images), IN_OPEN)
finished = libc.inotify_add_watch(events, os.fsencode(saved), IN_MOVED_TO)
assert events >= 0 and watched >= 0 and finished >= 0
child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
stream = b''
while True:
    ended = child.poll() is not None
    try:
        stream += os.read(events, 1 << 16)
    except BlockingIOError:
        if ended:
            break
        try:
            child.wait(0.02)
        except subprocess.TimeoutExpired:
            pass
assert child.returncode == 0, f'exit status {child.returncode}'
names = sorted(os.path.splitext(name)[0] for name in os.listdir(images))
at = 0
done = ahead = 0
while at < len(stream):
    watch, _, _, size = struct.unpack_from('iIII', stream, at)
    name = stream[at + 16:at + 16 + size].rstrip(b'\0').decode()
    stem = os.path.splitext(name)[0]
    at += 16 + size
    if watch == finished and done < len(names) and stem == names[done]:
        done += 1
    elif watch == watched and 0 < done < len(names) and stem in names[done + 1:]:
        ahead += 1
print(f'{done} of {len(names)} images are saved, {ahead} times an image was opened ahead')
sys.exit(done != len(names) or not ahead)
