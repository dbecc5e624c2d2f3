// Memory of a process that runs for days: what it takes shall not change once it has all it needs.
//
// glibc gives each thread a heap of its own, whose holes add up, and hands memory back between two
// scans, to ask for it again at the next; here there is one heap, and it keeps what it has.
#pragma once

namespace lamina {

// To be called at the start, before other threads.
void KeepHeapSteady();

}  // namespace lamina
