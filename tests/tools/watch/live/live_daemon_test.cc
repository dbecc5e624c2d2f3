// A daemon at work, met from outside: over HTTP, by signals, in a browser; and one that localises.

#include "tests/support/program/browser.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>
#include <sys/stat.h>

#include <filesystem>
#include <string>

#include "io/map/surfel_reader.h"
#include "tests/support/program/watch_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class WatchLiveTest : public WatchTest {
 protected:
  // Starts a daemon with the live page on a port, 0 for any, and waits until it serves.
  pid_t Serve(const Arguments& more = {}, int port = 0) {
    Arguments arguments = more;
    arguments.insert(arguments.end(), {"--http", "127.0.0.1:" + std::to_string(port)});
    const pid_t daemon = StartWatch(arguments);
    const std::string where = "live page at http://127.0.0.1:";
    EXPECT_TRUE(WaitUntil(daemon, [&] { return Said(where); }));
    const std::string said = Bytes(Path("stderr"));
    port_ = std::atoi(said.c_str() + said.find(where) + where.size());
    client_ = std::make_unique<httplib::Client>("127.0.0.1", port_);
    return daemon;
  }

  nlohmann::json Status() const {
    const auto answer = client_->Get("/api/status");
    return answer ? nlohmann::json::parse(answer->body) : nlohmann::json();
  }
  testing::AssertionResult WaitForFrames(pid_t daemon, int frames) const {
    return WaitUntil(daemon, [&] {
      const nlohmann::json status = Status();
      // The last pose is told when it is durable.
      return status.is_object() && status["state"] == "idle" && status["last_pose"].is_object() &&
             status["last_pose"]["index"] == frames - 1;
    });
  }
  int Post(const std::string& route) const {
    std::string token = Bytes(Path("session/token"));
    token.erase(token.find_last_not_of('\n') + 1);
    const auto answer = client_->Post(
        route.c_str(), httplib::Headers{{"Authorization", "Bearer " + token}}, "", "text/plain");
    return answer ? answer->status : 0;
  }

  int port_ = 0;
  std::unique_ptr<httplib::Client> client_;
};

TEST_F(WatchLiveTest, StatusAndMapGrowAndPostsAct) {
  DropScans(Street(30), 0, 8);
  const pid_t daemon = Serve();
  ASSERT_TRUE(WaitForFrames(daemon, 8));
  const nlohmann::json first = Status();
  EXPECT_EQ(first["queue"], 0);
  EXPECT_GT(first["map_bytes"], 0);
  EXPECT_TRUE(first["checkpoint"].is_null());
  EXPECT_EQ(Post("/api/checkpoint"), 202);
  ASSERT_TRUE(WaitUntil(daemon, [&] { return !Status()["checkpoint"].is_null(); }));
  EXPECT_EQ(Status()["checkpoint"]["frame"], 7);
  EXPECT_TRUE(fs::exists(Path("session/checkpoint-8.lmap")));
  DropScans(Street(30), 8, 30);
  ASSERT_TRUE(WaitForFrames(daemon, 30));
  EXPECT_GT(Status()["map_bytes"], first["map_bytes"]);
  EXPECT_GT(Status()["solves"], first["solves"]);
  EXPECT_EQ(Status()["frames"], 30);
  const nlohmann::json verdict = Status()["verdict"];
  EXPECT_EQ(verdict["verdict"], "good");
  EXPECT_THAT(client_->Get("/metrics")->body, HasSubstr("\nlamina_frames_total 30\n"));
  EXPECT_EQ(client_->Get("/healthz")->status, 200);
  const auto map = client_->Get("/api/map?x=0&y=0&z=0&radius=60&page=0");
  ASSERT_TRUE(map);
  ASSERT_EQ(map->status, 200);
  std::uint32_t on_page = 0;
  std::memcpy(&on_page, map->body.data() + 32, sizeof(on_page));
  EXPECT_GT(on_page, 100U);
  // Nothing without the token.
  EXPECT_EQ(client_->Post("/api/stop")->status, 401);
  EXPECT_TRUE(IsRunning(daemon));
  EXPECT_EQ(Post("/api/stop"), 202);
  EXPECT_EQ(WaitFor(daemon).code, 0);
  EXPECT_GE(Summary("session")["map_surfels"], on_page);
  EXPECT_EQ(Summary("session")["verdict"], verdict);
  Run(Path("in"));
  ExpectSameResults("session", "out");
}

TEST_F(WatchLiveTest, ABusyPortIsAClearError) {
  const pid_t daemon = Serve();
  const Outcome second = Once({"--http", "127.0.0.1:" + std::to_string(port_)}, 1, "other");
  EXPECT_THAT(second.err, HasSubstr(std::to_string(port_)));
  EXPECT_EQ(kill(daemon, SIGTERM), 0);
  EXPECT_EQ(WaitFor(daemon).code, 0);
}

TEST_F(WatchLiveTest, TheHangUpSignalReadsTheConfigurationAgain) {
  Write("watch.yaml", "session:\n  checkpoint_every_scans: 1000\nlog:\n  level: info\n");
  DropScans(Street(30), 0, 6);
  const pid_t daemon = StartWatch({"--config", Path("watch.yaml")});
  ASSERT_TRUE(WaitForScans(daemon, 6));
  const auto reload = [&](const std::string& yaml, const std::string& answer) {
    Write("watch.yaml", yaml);
    ASSERT_EQ(kill(daemon, SIGHUP), 0);
    ASSERT_TRUE(WaitUntil(daemon, [&] { return Said(answer); }));
  };
  reload("session: [", "the configuration stays as it was");
  reload("session:\n  checkpoint_every_scans: 0\n", "session.checkpoint_every_scans");
  reload("map:\n  root_size_m: 3\n", "a session keeps those that it was begun with");
  EXPECT_FALSE(Said("checkpoint after scan"));
  reload("session:\n  checkpoint_every_scans: 4\n", "hold from now on");
  DropScans(Street(30), 6, 12);
  ASSERT_TRUE(WaitUntil(daemon, [&] { return Said("checkpoint after scan"); }));
  // Of what follows only errors are told.
  Write("watch.yaml", "session:\n  checkpoint_every_scans: 1\nlog:\n  level: error\n");
  ASSERT_EQ(kill(daemon, SIGHUP), 0);
  DropScans(Street(30), 12, 20);
  ASSERT_TRUE(WaitForScans(daemon, 20));
  Terminate(daemon);
  EXPECT_FALSE(Said("frames mapped in all"));
  Run(Path("in"));
  ExpectSameResults("session", "out");
}

TEST_F(WatchLiveTest, LocalisesInAFinishedMapAndLeavesItAsItIs) {
  const Recording street = Street(40);
  DropScans(street, 0, 40);
  Once();
  const Trajectory mapped = AllScans("session");
  std::map<std::string, std::string> before;
  for (const std::string& name : FilesIn("session")) before[name] = Bytes(Path("session/" + name));
  // How scans are prepared is the affair of each recording.
  Arguments localise{"--mode", "localise", "--map", Path("session"), "--start",
                     "0.4",    "0.3",      "0",     "--set",         "preparation.max_range_m=60"};
  Once(localise, 0, "localised");
  const Trajectory found = AllScans("localised");
  ASSERT_THAT(found, SizeIs(40));
  EXPECT_LT(LargestDistance(found, mapped), 0.05);
  EXPECT_EQ(Summary("localised")["lost_frames"], 0);
  for (const auto& [name, bytes] : before) {
    EXPECT_TRUE(Bytes(Path("session/" + name)) == bytes) << name << " has changed";
  }
  // No map, or none that is finished.
  localise[3] = Path("nothing");
  EXPECT_THAT(Once(localise, 1, "lost").err, HasSubstr("holds no map"));
}

TEST_F(WatchLiveTest, LocalisesFromAStartInMotion) {
  constexpr std::size_t kFirst = 25, kScans = 56;
  const Recording street = SyntheticRecording(synth::SceneKind::kStreet, kScans, 1);
  Run(WriteRecording("all", street));
  const Trajectory truth = AllScans();
  // Every other scan makes the map, those between, 2 m apart, are to be found in it.
  Recording even, odd;
  Trajectory odd_truth;
  for (std::size_t i = 0; i + 1 < kScans; i += 2) {
    even.push_back(street[i]);
    if (i + 1 < kFirst) continue;
    odd.push_back(street[i + 1]);
    odd_truth.push_back(truth[i + 1]);
  }
  DropScans(even, 0, even.size());
  Once();
  const SE3& T = odd_truth[0].T_world_lidar;
  const Outcome outcome = Lamina({"watch",
                                  "--inbox",
                                  WriteRecording("visit", odd),
                                  "--session",
                                  Path("localised"),
                                  "--http",
                                  "off",
                                  "--once",
                                  "--mode",
                                  "localise",
                                  "--map",
                                  Path("session"),
                                  "--start",
                                  fmt::format("{}", T.t.x() + 0.3),
                                  fmt::format("{}", T.t.y() - 0.2),
                                  fmt::format("{}", T.t.z()),
                                  fmt::format("{}", T.q.x()),
                                  fmt::format("{}", T.q.y()),
                                  fmt::format("{}", T.q.z()),
                                  fmt::format("{}", T.q.w())});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Trajectory found = AllScans("localised");
  ASSERT_EQ(found.size(), odd_truth.size());
  EXPECT_LT(LargestDistance(found, odd_truth), 0.1);
}

TEST_F(WatchLiveTest, ThePageShowsARunningSessionAndSurvivesItsRestart) {
  if (!Browser::IsInstalled()) GTEST_SKIP() << "chromium and chromium-driver are not installed";
  DropScans(Street(40), 0, 10);
  pid_t daemon = Serve();
  ASSERT_TRUE(WaitForFrames(daemon, 10));
  Browser browser(Path("profile"), 1000, 700);
  browser.Go("http://127.0.0.1:" + std::to_string(port_) + "/");
  EXPECT_FALSE(browser.WaitFor("lamina.state.poses.length === 10").is_null());
  EXPECT_FALSE(browser.WaitFor("lamina.viewer.map.count > 500").is_null());
  const double surfels = browser.Run("return lamina.viewer.map.count");
  DropScans(Street(40), 10, 25);
  EXPECT_FALSE(browser.WaitFor("lamina.state.poses.length === 25").is_null());
  EXPECT_FALSE(browser.WaitFor("lamina.viewer.map.count > " + std::to_string(surfels)).is_null());
  EXPECT_GT(browser.Run("return lamina.viewer.countPixels()"), 5000);
  EXPECT_THAT(browser.Errors(), IsEmpty());
  // Killed, and started again where the browser looks for it.
  EXPECT_EQ(kill(daemon, SIGKILL), 0);
  WaitFor(daemon);
  EXPECT_FALSE(browser.WaitFor("!document.getElementById('banner').hidden").is_null());
  daemon = Serve({}, port_);
  EXPECT_FALSE(browser.WaitFor("document.getElementById('banner').hidden").is_null());
  EXPECT_FALSE(browser.WaitFor("lamina.state.poses.length === 25").is_null());
  DropScans(Street(40), 25, 40);
  EXPECT_FALSE(browser.WaitFor("lamina.state.poses.length === 40").is_null());
  EXPECT_FALSE(browser.WaitFor("lamina.viewer.map.count > " + std::to_string(surfels)).is_null());
  const double shown =
      browser.Run("return parseFloat(document.getElementById('path-length').textContent)");
  Terminate(daemon);
  const Trajectory poses = AllScans("session");
  double length = 0.0;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    length += (poses[k].T_world_lidar.t - poses[k - 1].T_world_lidar.t).norm();
  }
  EXPECT_NEAR(shown, length, 0.5);
}

}  // namespace
}  // namespace lamina
