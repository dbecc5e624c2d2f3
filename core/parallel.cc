#include "core/parallel.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <utility>

#if defined(LAMINA_THREAD_SANITIZER)
#include <sanitizer/tsan_interface.h>
#endif

namespace lamina {
namespace {

// Tells the thread sanitizer in what order TBB runs things: what a thread did before Give() comes
// before what another one does after Take().
//
// TBB as it is installed is not built with the sanitizer, which does not see the atomics that hand
// work from thread to thread and would take for a race whatever they keep in order. So this file is
// built without it, too (CMakeLists.txt), and states each order that TBB promises, and no more:
// everything else that two threads do is checked. In other builds it is nothing.
class Handover {
 public:
#if defined(LAMINA_THREAD_SANITIZER)
  void Give() { __tsan_release(&place_); }
  void Take() { __tsan_acquire(&place_); }

 private:
  // Places within the same 8 bytes are one place to the sanitizer.
  alignas(8) char place_[8] = {};
#else
  void Give() {}
  void Take() {}
#endif
};

// Work that was handed over, and is handed on when it ends, however it ends.
class Turn {
 public:
  Turn(Handover* from, Handover* to) : to_(to) { from->Take(); }
  ~Turn() { to_->Give(); }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  Handover* to_;
};

// The other side: who hands work out, and has it back when the work has ended, however it ended.
class HandedOut {
 public:
  HandedOut(Handover* to, Handover* from) : from_(from) { to->Give(); }
  ~HandedOut() { from_->Take(); }
  HandedOut(const HandedOut&) = delete;
  HandedOut& operator=(const HandedOut&) = delete;

 private:
  Handover* from_;
};

}  // namespace

namespace internal {

void RunParallel(size_t count, void (*run)(const void* context, size_t i), const void* context) {
  Handover to_workers, from_workers;
  const HandedOut handed_out(&to_workers, &from_workers);
  // Isolated: a thread that waits for the last call must not start a long task from elsewhere.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 1), [&](const auto& range) {
      const Turn turn(&to_workers, &from_workers);
      for (size_t i = range.begin(); i != range.end(); ++i) run(context, i);
    });
  });
}

}  // namespace internal

struct Background::Group {
  tbb::task_group tasks;
  std::function<void()> work;
  Handover to_work, from_work;
};

Background::Background() : group_(std::make_unique<Group>()) {}

Background::~Background() { Wait(); }

void Background::Start(std::function<void()> work) {
  Group* const group = group_.get();
  group->work = std::move(work);
  group->to_work.Give();
  group->tasks.run([group] {
    const Turn turn(&group->to_work, &group->from_work);
    group->work();
  });
}

void Background::Wait() {
  group_->tasks.wait();
  group_->from_work.Take();
}

void RunPipeline(size_t most, PipelineStages* stages) {
  Handover to_stages, from_stages, begun, ended;
  // Items that are `most` apart follow one another.
  std::vector<Handover> items(most);
  size_t next = 0;
  const auto begin = [&](tbb::flow_control& control) {
    const size_t i = next++;
    const Turn stage(&to_stages, &from_stages);
    const Turn in_order(&begun, &begun);
    const Turn item(&items[i % most], &items[i % most]);
    if (!stages->Begin(i)) control.stop();
    return i;
  };
  const auto work = [&](size_t i) {
    const Turn stage(&to_stages, &from_stages);
    const Turn item(&items[i % most], &items[i % most]);
    stages->Work(i);
    return i;
  };
  const auto end = [&](size_t i) {
    const Turn stage(&to_stages, &from_stages);
    const Turn in_order(&ended, &ended);
    const Turn item(&items[i % most], &items[i % most]);
    stages->End(i);
  };
  const HandedOut handed_out(&to_stages, &from_stages);
  tbb::parallel_pipeline(
      most, tbb::make_filter<void, size_t>(tbb::filter_mode::serial_in_order, begin) &
                tbb::make_filter<size_t, size_t>(tbb::filter_mode::parallel, work) &
                tbb::make_filter<size_t, void>(tbb::filter_mode::serial_in_order, end));
}

}  // namespace lamina
