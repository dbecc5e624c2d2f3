// The live page in a browser, fed by a server as the daemon's is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>
#include <set>
#include <string>

#include "tests/support/files/io_test_files.h"
#include "tests/support/program/browser.h"
#include "tests/support/scenes/live_world.h"
#include "tools/watch/live/server.h"

namespace lamina {
namespace {

using testing::IsEmpty;

// What `lamina watch` does around a scan, without the mapping: see tools/watch/live/view.h.
class FakeDaemon {
 public:
  FakeDaemon(int port, const std::string& session, LiveWorld* world, std::int64_t first_frame)
      : world_(world), next_(first_frame) {
    HttpParts parts;
    parts.view = &view_;
    parts.session = session;
    parts.map = [world](const MapQuery& query) { return world->Answer(query); };
    parts.checkpoint = parts.stop = [] {};
    server_ = std::make_unique<HttpServer>(HttpAddress{"127.0.0.1", port}, parts);
    for (std::int64_t i = 0; i < first_frame; ++i) view_.AddFrame(LiveWorld::Frame(i));
    Step(1);
  }

  void Step(int frames) {
    for (int i = 0; i < frames; ++i, ++next_) {
      view_.AddFrame(LiveWorld::Frame(next_));
      view_.SetScan(LiveWorld::Scan(next_));
    }
    LiveStatus status;
    status.state = LiveState::kMapping;
    status.frames = static_cast<std::uint64_t>(next_);
    status.keyframes = status.frames / 2;
    status.map_surfels = world_->size();
    status.map_bytes = 120 * world_->size();
    status.map_budget_bytes = 2048ULL << 20U;
    status.checkpoint = LiveStatus::Checkpoint{next_, 1000000, 12.0};
    view_.SetStatus(status);
  }

  LiveView& view() { return view_; }
  int port() const { return server_->port(); }

 private:
  LiveView view_;
  LiveWorld* world_;
  std::int64_t next_;
  std::unique_ptr<HttpServer> server_;
};

// Starting a browser takes longer than most of what is looked at in it: the tests share one, each
// with a daemon, and so a page, of its own.
class LivePage : public FilesTest {
 protected:
  static void SetUpTestSuite() {
    profiles_ = std::filesystem::path(testing::TempDir()) / "lamina_LivePage_profiles";
    std::filesystem::remove_all(profiles_);
    std::filesystem::create_directories(profiles_);
  }
  static void TearDownTestSuite() {
    shared_.reset();
    std::filesystem::remove_all(profiles_);
  }

  void SetUp() override {
    if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  }

  void TearDown() override {
    if (browser_ == nullptr) return;
    // The page is left before its daemon ends, and what it complained about with it.
    browser_->Go("about:blank");
    browser_->Errors();
  }

  void Open() {
    if (shared_ == nullptr) {
      shared_ = std::make_unique<Browser>((profiles_ / "desk").string(), 900, 640);
    }
    browser_ = shared_.get();
    OpenPage();
  }

  void OpenOnAPhone(int width, int height) {
    phone_ = std::make_unique<Browser>(Path("phone"), width, height, true);
    browser_ = phone_.get();
    OpenPage();
  }

  double PathLength() const {
    return browser_->Run("return parseFloat(document.getElementById('path-length').textContent)");
  }
  bool WaitForSurfels(std::size_t count) const {
    return !browser_->WaitFor("lamina.viewer.map.count === " + std::to_string(count)).is_null();
  }

  LiveWorld world_{60.0, 0.5};
  std::unique_ptr<FakeDaemon> daemon_;
  Browser* browser_ = nullptr;

 private:
  void OpenPage() {
    daemon_ = std::make_unique<FakeDaemon>(0, Path(""), &world_, 20);
    browser_->Go("http://127.0.0.1:" + std::to_string(daemon_->port()) + "/");
  }

  static inline std::filesystem::path profiles_;
  static inline std::unique_ptr<Browser> shared_;
  std::unique_ptr<Browser> phone_;
};

TEST_F(LivePage, ShowsMapAndMovingTrajectory) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  // No more than the sensor and the line would cover a hundredth of the view.
  const char* const kShare =
      "return lamina.viewer.countPixels() / (lamina.viewer.canvas.width * "
      "lamina.viewer.canvas.height)";
  EXPECT_GT(browser_->Run(kShare), 0.05);
  const double before = PathLength();
  EXPECT_NEAR(before, 20.0, 2.0);
  const std::string picture = browser_->Screenshot();
  daemon_->Step(25);
  EXPECT_FALSE(browser_->WaitFor("lamina.state.poses.length === 46").is_null());
  EXPECT_NEAR(PathLength(), before + 25.0, 2.0);
  EXPECT_FALSE(browser_->WaitFor("lamina.state.scan === 45").is_null());
  EXPECT_NE(browser_->Screenshot(), picture);
  // The camera has followed the sensor.
  const nlohmann::json target = browser_->Run("return lamina.viewer.target()");
  EXPECT_NEAR(target[0], 45.0, 1e-3);
  EXPECT_THAT(browser_->Errors(), IsEmpty());
}

TEST_F(LivePage, ShowsTheVerdict) {
  Open();
  EXPECT_FALSE(
      browser_->WaitFor("document.getElementById('verdict').textContent === 'good'").is_null());
  LiveStatus status;
  status.verdict = {RunVerdict::Grade::kWrong, {"20 % <b>lost", "2 pieces"}, "Look."};
  daemon_->view().SetStatus(status);
  EXPECT_FALSE(browser_
                   ->WaitFor("document.getElementById('verdict').textContent === "
                             "'wrong: 20 % <b>lost; 2 pieces. Look.'")
                   .is_null());
  EXPECT_EQ(browser_->Run("return document.getElementById('verdict').dataset.tone"), "bad");
  EXPECT_THAT(browser_->Errors(), IsEmpty());
}

TEST_F(LivePage, RevisedPosesAndNewSurfelsArrive) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  std::vector<LivePose> revised;
  for (int i = 10; i < 15; ++i) {
    revised.push_back(LiveWorld::Frame(i).pose);
    revised.back().T_world_lidar.t.z() = 3.5;
  }
  daemon_->view().RevisePoses(revised);
  EXPECT_FALSE(browser_->WaitFor("lamina.state.poses[14].position[2] === 3.5").is_null());
  EXPECT_EQ(browser_->Run("return lamina.state.poses.length"), 21);
  EXPECT_EQ(browser_->Run("return lamina.state.poses[15].position[2]"), 1.7);
  const std::size_t before = world_.size();
  // Two in a cell that has surfels, one where nothing was.
  world_.Grow({20.1, 0.1, 0.1});
  world_.Grow({20.2, 0.2, 0.2});
  world_.Grow({20.0, 0.0, 12.0});
  EXPECT_TRUE(WaitForSurfels(before + 3));
  EXPECT_THAT(browser_->Errors(), IsEmpty());
}

TEST_F(LivePage, ASmallBudgetKeepsWhatIsNear) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  browser_->Run(
      "const list = document.getElementById('budget'); list.add(new Option('few', '4000')); "
      "list.value = '4000'; list.dispatchEvent(new Event('change'));");
  EXPECT_FALSE(browser_->WaitFor("lamina.viewer.map.count <= 4000").is_null());
  EXPECT_GT(browser_->Run("return lamina.viewer.map.count"), 0);
  // It still follows what is new.
  daemon_->Step(5);
  EXPECT_FALSE(browser_->WaitFor("lamina.state.poses.length === 26").is_null());
  EXPECT_THAT(browser_->Errors(), IsEmpty());
}

TEST_F(LivePage, EveryColouringDrawsAPictureOfItsOwn) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  std::set<std::string> pictures, legends;
  for (const char* colour : {"height", "thickness", "age"}) {
    const std::string choose = std::string("const list = document.getElementById('colour'); ") +
                               "list.value = '" + colour +
                               "'; list.dispatchEvent(new Event('change')); lamina.viewer.draw();";
    // The drawing must be read in the task that made it.
    pictures.insert(
        browser_->Run(choose + "return lamina.viewer.canvas.toDataURL()").get<std::string>());
    legends.insert(
        browser_->Run("return document.getElementById('legend').innerText").get<std::string>());
  }
  EXPECT_EQ(pictures.size(), 3U);
  EXPECT_EQ(legends.size(), 3U);
}

TEST_F(LivePage, SurvivesARestartOfTheDaemon) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  const int port = daemon_->port();
  const std::string run = daemon_->view().run_id();
  daemon_.reset();
  EXPECT_FALSE(browser_->WaitFor("!document.getElementById('banner').hidden").is_null());
  // Another trajectory and another map; what the page had must be gone.
  LiveWorld other(30.0, 0.5);
  daemon_ = std::make_unique<FakeDaemon>(port, Path(""), &other, 5);
  EXPECT_FALSE(browser_->WaitFor("document.getElementById('banner').hidden").is_null());
  EXPECT_TRUE(WaitForSurfels(other.size()));
  EXPECT_FALSE(browser_->WaitFor("lamina.state.poses.length === 6").is_null());
  EXPECT_EQ(browser_->Run("return lamina.state.run"), daemon_->view().run_id());
  EXPECT_NE(daemon_->view().run_id(), run);
  EXPECT_NEAR(PathLength(), 5.0, 1.0);
  daemon_.reset();
}

TEST_F(LivePage, KeyboardTurnsZoomsAndStopsFollowing) {
  Open();
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  // Presses a key, and tells where the camera is then.
  const auto press = [&](const std::string& key) {
    return browser_->Run(
        "const v = lamina.viewer; v.canvas.dispatchEvent(new KeyboardEvent('keydown', {key: '" +
        key +
        "', bubbles: true})); return {distance: v.camera.position.distanceTo(v.controls.target), "
        "height: v.camera.position.z};");
  };
  const nlohmann::json start = press("none"), nearer = press("+"), higher = press("ArrowUp");
  EXPECT_LT(nearer["distance"], 0.9 * start["distance"].get<double>());
  EXPECT_GT(higher["height"], 0.1 + nearer["height"].get<double>());
  EXPECT_TRUE(browser_->Run("return lamina.viewer.follow"));
  press("f");
  EXPECT_FALSE(browser_->Run("return lamina.viewer.follow"));
  EXPECT_FALSE(browser_->Run("return document.getElementById('follow').checked"));
}

TEST_F(LivePage, FitsOnAPhone) {
  OpenOnAPhone(390, 844);
  ASSERT_TRUE(WaitForSurfels(world_.size()));
  EXPECT_EQ(browser_->Run("return innerWidth"), 390);
  EXPECT_EQ(browser_->Run("return document.documentElement.scrollWidth - innerWidth"), 0);
  EXPECT_EQ(browser_->Run("return document.querySelector('.panel').scrollWidth - "
                          "document.querySelector('.panel').clientWidth"),
            0);
  EXPECT_GT(browser_->Run("return document.querySelector('.view').clientHeight"), 300);
  EXPECT_GT(browser_->Run("return lamina.viewer.countPixels()"), 5000);
}

}  // namespace
}  // namespace lamina
