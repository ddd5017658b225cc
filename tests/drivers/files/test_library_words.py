"""Words of libraries, as a sentence can hold them."""

from __future__ import annotations

import errno
import os

import pytest
import serial
import usb.core

from slopegate.drivers.files.library_words import fault_inside, words_of


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (serial.SerialException(21, "could not open port /tmp: [Errno 21] Is a directory: '/tmp'"), os.strerror(21)),
        (serial.SerialException("Could not configure port: (5, 'Input/output error')"), "Could not configure port"),
        (usb.core.USBError("Input/Output Error", -1, errno.EIO), os.strerror(errno.EIO)),
        (usb.core.USBError("Other error", -99, None), "Other error"),
        (ValueError("Node is not writable. : AccessException thrown (file 'I.cpp', line 5)"), "Node is not writable"),
        (RuntimeError("\x1b[31mtwo\nlines.\n"), "\\x1b[31mtwo lines"),
        (RuntimeError(), "RuntimeError"),
    ],
)
def test_they_are_short_and_plain(error: Exception, said: str) -> None:
    assert words_of(error) == said


def test_endless_ones_are_shortened() -> None:
    assert len(words_of(RuntimeError("word " * 1000))) <= 160


def test_a_bug_is_told_by_its_kind_alone() -> None:
    assert fault_inside(KeyError("x")) == "failed inside the program (KeyError): the log has the details"
    assert fault_inside(MemoryError()) == "failed: there is not enough memory for it"
