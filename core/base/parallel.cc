#include "core/base/parallel.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <atomic>
#include <exception>
#include <limits>
#include <mutex>
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

// What numbered calls throw, kept from TBB: there an exception cancels all other work of its group
// while that may be just ending, which has crashed (libtbb 2021.8). Of several exceptions the one
// with the lowest number is kept, whichever came first: calls with lower numbers are still made.
class FirstError {
 public:
  // Calls work() and keeps what it throws, unless a call with this number or a lower one has
  // thrown.
  template <typename Work>
  void Guard(size_t number, const Work& work) {
    if (number >= first_) return;
    try {
      work();
    } catch (...) {
      Keep(number, std::current_exception());
    }
  }
  // When all calls have ended.
  void Rethrow() {
    if (error_) std::rethrow_exception(std::exchange(error_, nullptr));
  }

 private:
  void Keep(size_t number, std::exception_ptr error) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (number >= first_) return;
    error_.swap(error);
    first_ = number;
  }

  std::mutex mutex_;
  std::atomic<size_t> first_{std::numeric_limits<size_t>::max()};
  std::exception_ptr error_;
};

}  // namespace

namespace internal {

void RunParallel(size_t count, void (*run)(const void* context, size_t i), const void* context) {
  FirstError error;
  {
    Handover to_workers, from_workers;
    const HandedOut handed_out(&to_workers, &from_workers);
    // Isolated: a thread that waits for the last call must not start a long task from elsewhere.
    tbb::this_task_arena::isolate([&] {
      tbb::parallel_for(tbb::blocked_range<size_t>(0, count, 1), [&](const auto& range) {
        const Turn turn(&to_workers, &from_workers);
        for (size_t i = range.begin(); i != range.end(); ++i) {
          error.Guard(i, [&] { run(context, i); });
        }
      });
    });
  }
  error.Rethrow();
}

}  // namespace internal

struct Background::Group {
  tbb::task_group tasks;
  std::function<void()> work;
  std::exception_ptr error;  // what the work threw
  Handover to_work, from_work;

  void Wait() {
    tasks.wait();
    from_work.Take();
  }
};

Background::Background() : group_(std::make_unique<Group>()) {}

Background::~Background() { group_->Wait(); }

void Background::Start(std::function<void()> work) {
  Group* const group = group_.get();
  group->work = std::move(work);
  group->to_work.Give();
  group->tasks.run([group] {
    const Turn turn(&group->to_work, &group->from_work);
    try {
      group->work();
    } catch (...) {
      group->error = std::current_exception();
    }
  });
}

void Background::Wait() {
  group_->Wait();
  if (group_->error) std::rethrow_exception(std::exchange(group_->error, nullptr));
}

namespace {

// The stages as TBB calls them: none throws, and an item whose call has failed, or that comes after
// such an item, goes through untouched.
class GuardedStages {
 public:
  GuardedStages(size_t most, PipelineStages* stages) : stages_(stages), items_(most) {}

  // Whether there is a next item, and which.
  bool Begin(size_t* i) {
    *i = next_++;
    const Turn stage(&to_stages_, &from_stages_);
    const Turn in_order(&begun_, &begun_);
    const Turn item(Item(*i), Item(*i));
    bool begun = false;
    error_.Guard(*i, [&] { begun = stages_->Begin(*i); });
    return begun;
  }
  void Work(size_t i) {
    const Turn stage(&to_stages_, &from_stages_);
    const Turn item(Item(i), Item(i));
    error_.Guard(i, [&] { stages_->Work(i); });
  }
  void End(size_t i) {
    const Turn stage(&to_stages_, &from_stages_);
    const Turn in_order(&ended_, &ended_);
    const Turn item(Item(i), Item(i));
    error_.Guard(i, [&] { stages_->End(i); });
  }

  Handover* to_stages() { return &to_stages_; }
  Handover* from_stages() { return &from_stages_; }
  void Rethrow() { error_.Rethrow(); }

 private:
  Handover* Item(size_t i) { return &items_[i % items_.size()]; }

  PipelineStages* stages_;
  size_t next_ = 0;
  Handover to_stages_, from_stages_, begun_, ended_;
  std::vector<Handover> items_;  // items that are items_.size() apart follow one another
  FirstError error_;
};

}  // namespace

void RunPipeline(size_t most, PipelineStages* stages) {
  GuardedStages guarded(most, stages);
  const auto begin = [&](tbb::flow_control& control) {
    size_t i = 0;
    if (!guarded.Begin(&i)) control.stop();
    return i;
  };
  const auto work = [&](size_t i) {
    guarded.Work(i);
    return i;
  };
  const auto end = [&](size_t i) { guarded.End(i); };
  {
    const HandedOut handed_out(guarded.to_stages(), guarded.from_stages());
    tbb::parallel_pipeline(
        most, tbb::make_filter<void, size_t>(tbb::filter_mode::serial_in_order, begin) &
                  tbb::make_filter<size_t, size_t>(tbb::filter_mode::parallel, work) &
                  tbb::make_filter<size_t, void>(tbb::filter_mode::serial_in_order, end));
  }
  guarded.Rethrow();
}

}  // namespace lamina
