// Memory of a process that runs for days: what it takes shall not change once it has all it needs.
//
// Scans differ a little in size, and so does every buffer that is made for one. A block that is
// given back nearly fits the next, but not quite; the heap fills with holes and grows, slowly, for
// hours. So wherever this file is linked, operator new rounds large blocks up to one of four sizes
// for each power of two, and what one scan has left behind fits another. glibc's malloc itself is
// told by KeepHeapSteady.
#pragma once

#include <cstddef>

namespace lamina {

// What operator new asks malloc for.
std::size_t RoundedBlock(std::size_t bytes);

// To be called at the start, before other threads. One heap for all threads, where glibc would give
// each its own, whose holes add up; and memory is not handed back between two scans, to be asked
// for again at the next.
void KeepHeapSteady();

}  // namespace lamina
