// The inbox under chance: what comes out must not depend on how and when files arrived.
#include <algorithm>
#include <atomic>
#include <numeric>
#include <random>
#include <thread>

#include "tests/support/files/inbox_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::IsEmpty;

class InboxRandomTest : public InboxScene {
 protected:
  InboxRandomTest() { options_.watch = InboxOptions::Watch::kInotify; }

  int Draw(int most) { return std::uniform_int_distribution<int>(0, most)(random_); }

  // Names as recorders give them, and mixtures.
  std::string DrawName(int style) {
    switch (style) {
      case 0:
        return std::to_string(Draw(30)) + ".bin";
      case 1:
        return "scan_" + std::to_string(Draw(200)) + (Draw(1) != 0 ? ".bin" : ".ply");
      case 2:
        return std::to_string(Draw(3)) + "." + std::to_string(Draw(99)) + ".bin";
      case 3:
        return "17000000001234567" + std::to_string(10 + Draw(89)) + ".bin";
      default:
        return DrawName(Draw(3));
    }
  }

  std::mt19937 random_{7};
};

TEST_F(InboxRandomTest, DrainedItHasTheOrderAndTheStampsOfTheRecording) {
  const char* const folders[] = {"", "s", "s/velodyne", "d/velodyne_points/data"};
  const char* const stamp_files[] = {"times.txt", "s/timestamps.txt", "s/times.txt",
                                     "d/velodyne_points/timestamps.txt"};
  for (int round = 0; round < 150; ++round) {
    fs::remove_all(In(""));
    const int layout = Draw(3), style = Draw(4);
    std::set<std::string> names;
    for (int i = Draw(12); i >= 0; --i) names.insert(DrawName(style));
    const std::string folder = folders[layout];
    for (const std::string& name : names) {
      Write("in/" + (folder.empty() ? name : folder + "/" + name), OnePoint());
    }
    if (Draw(1) == 0) {
      std::string stamps;
      for (std::size_t i = 0; i < names.size() + static_cast<std::size_t>(Draw(1) * Draw(25));
           ++i) {
        stamps += std::to_string(i) + "." + std::to_string(Draw(99)) + "\n";
      }
      Write(std::string("in/") + stamp_files[layout], stamps);
    }
    const auto source = OpenScans(In(folder), scans_);
    Open();
    if (Draw(1) == 0) inbox_->Wait(std::chrono::seconds(0));
    inbox_->Drain();
    for (std::size_t i = 0; i < source->size(); ++i) {
      const auto file = inbox_->Next();
      ASSERT_TRUE(file) << round;
      ASSERT_EQ(fs::path(file->name).filename(), fs::path(source->Name(i)).filename()) << round;
      ASSERT_EQ(file->stamp_ns, source->Stamp(i)) << round << " " << file->name;
      ASSERT_EQ(file->next_stamp_ns.has_value(), i == 0 && source->size() > 1) << round;
    }
    ASSERT_FALSE(inbox_->Next()) << round;
    ASSERT_THAT(Late(), IsEmpty()) << round;
  }
}

TEST_F(InboxRandomTest, ArrivalInAnyOrderWithinTheWaitChangesNothing) {
  options_.reorder_wait_s = 1.0;
  for (int round = 0; round < 60; ++round) {
    fs::remove_all(In(""));
    fs::create_directories(In(""));
    const bool stamps = Draw(1) == 0;
    std::vector<std::string> wanted;
    for (int i = 0; i < 30; ++i) {
      if (Draw(3) == 0) continue;  // a gap
      wanted.push_back(stamps ? "1" + std::to_string(100 + i) + ".5.bin"
                              : "scan" + std::to_string(i) + ".bin");
    }
    Open();
    std::vector<std::string> taken;
    // No file comes later than a second after one behind it: chunks of the order, each shuffled.
    std::vector<std::string> order = wanted;
    for (std::size_t begin = 0; begin < order.size();) {
      const std::size_t end = std::min(order.size(), begin + 1 + static_cast<std::size_t>(Draw(6)));
      std::shuffle(order.begin() + static_cast<std::ptrdiff_t>(begin),
                   order.begin() + static_cast<std::ptrdiff_t>(end), random_);
      for (; begin < end; ++begin) {
        Drop(order[begin]);
        const bool last_of_chunk = begin + 1 == end;
        Pass(last_of_chunk ? 1.01 : 0.1);
        for (const std::string& name : Take()) taken.push_back(name);
      }
    }
    Pass(20.0);
    for (const std::string& name : Take()) taken.push_back(name);
    ASSERT_EQ(taken, wanted) << round;
    ASSERT_THAT(Late(), IsEmpty());
  }
}

TEST_F(InboxRandomTest, NothingIsLostOrTakenTwiceWhileFoldersComeAndFill) {
  options_.reorder_wait_s = 0.0;
  options_.settle_s = 0.01;
  inbox_ = std::make_unique<Inbox>(Path("in"), scans_, options_, nullptr);
  constexpr int kFolders = 60, kFiles = 12;
  std::atomic<bool> done{false};
  std::thread writer([&] {
    for (int f = 0; f < kFolders; ++f) {
      const std::string folder = "a/" + std::to_string(f % 7) + "/" + std::to_string(f);
      for (int i = 0; i < kFiles; ++i) {
        const std::string name = folder + "/" + std::to_string(i) + ".bin";
        if (i % 2 == 0) {
          Drop(name);
        } else {
          Write("in/" + name + ".partial", OnePoint());
          fs::rename(In(name + ".partial"), In(name));
        }
      }
    }
    done = true;
    inbox_->Interrupt();
  });
  std::map<std::string, int> taken;
  const auto take = [&] {
    while (const auto file = inbox_->Next()) ++taken[file->name];
    for (const std::string& name : Late()) ++taken[name];
  };
  while (!done) {
    inbox_->Wait(std::chrono::seconds(500));
    take();
  }
  writer.join();
  inbox_->Drain();
  take();
  EXPECT_EQ(taken.size(), std::size_t{kFolders * kFiles});
  for (const auto& [name, times] : taken) EXPECT_EQ(times, 1) << name;
  EXPECT_THAT(Refused(), IsEmpty());
  EXPECT_EQ(inbox_->waiting(), 0U);
}

}  // namespace
}  // namespace lamina
