// What the server answers: status, trajectory, scan, map, metrics, health.
#include "tools/watch/live/server.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "core/base/error.h"
#include "tests/tools/watch/live/live_server_fixture.h"

namespace lamina {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

TEST(HttpAddress, IsHostAndPortOrOff) {
  EXPECT_FALSE(ParseHttpAddress("off"));
  EXPECT_EQ(ParseHttpAddress("127.0.0.1:8090")->host, "127.0.0.1");
  EXPECT_EQ(ParseHttpAddress("127.0.0.1:8090")->port, 8090);
  EXPECT_EQ(ParseHttpAddress("[::1]:0")->host, "::1");
  for (const char* bad : {"", ":", "8090", "host", "host:", ":80", "host:65536", "host:-1",
                          "host:80x", "::1:80", "[]:80", "host: 80"}) {
    EXPECT_THAT(MessageOf<OptionError>([&] { ParseHttpAddress(bad); }), HasSubstr("HOST:PORT"))
        << bad;
  }
}

TEST_F(HttpServerTest, SaysWhyItCannotListen) {
  Serve();
  const HttpAddress taken{"127.0.0.1", server_->port()};
  EXPECT_THAT(MessageOf<OutputError>([&] { HttpServer(taken, Parts()); }),
              AllOf(HasSubstr("127.0.0.1:" + std::to_string(taken.port)), HasSubstr("in use")));
  EXPECT_THAT(MessageOf<OutputError>([&] {
                HttpServer({"192.0.2.1", 0}, Parts());
              }),
              HasSubstr("192.0.2.1"));
  EXPECT_THAT(MessageOf<OptionError>([&] {
                HttpServer({"no host", 0}, Parts());
              }),
              HasSubstr("no host"));
  HttpParts parts = Parts();
  parts.session = Path("nowhere");
  EXPECT_THAT(MessageOf<OutputError>([&] {
                HttpServer({"127.0.0.1", 0}, parts);
              }),
              HasSubstr("nowhere/token"));
}

TEST_F(HttpServerTest, StatusTellsWhatTheBoardKnows) {
  Serve();
  LiveStatus status;
  status.state = LiveState::kMapping;
  status.frames = 3;
  status.T_map_world.t.x() = 0.5;
  status.verdict = {RunVerdict::Grade::kWrong, {"20 % of the scans are lost"}, "Look."};
  status.last_error = "bad \xff name";
  status.checkpoint = LiveStatus::Checkpoint{2, 1000, 4.5, {}};
  view_.SetStatus(status);
  for (int i = 1; i <= 3; ++i) view_.AddFrame(FrameAt(i));
  const auto answer = Client().Get("/api/status");
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  EXPECT_EQ(answer->get_header_value("Content-Type"), "application/json");
  const Json s = Json::parse(answer->body);
  EXPECT_EQ(s["state"], "mapping");
  EXPECT_EQ(s["frames"], 3);
  EXPECT_EQ(s["lag_s"], 0.003);
  EXPECT_EQ(s["latency_median_ms"], 2.0);
  EXPECT_EQ(s["checkpoint"]["frame"], 2);
  EXPECT_EQ(s["last_pose"]["position_m"][0], 3.0);
  EXPECT_EQ(s["last_pose"]["stamp_ns"], "300000000");
  EXPECT_EQ(s["last_pose_in_map"]["position_m"][0], 3.5);
  EXPECT_EQ(s["run_id"], view_.run_id());
  EXPECT_GT(s["rss_bytes"], 1000000);
  EXPECT_GT(s["rate_hz"], 0.0);
  EXPECT_FALSE(s["degenerate_now"]);
  EXPECT_EQ(s["verdict"]["verdict"], "wrong");
  EXPECT_EQ(s["verdict"]["reasons"][0], "20 % of the scans are lost");
}

TEST_F(HttpServerTest, TrajectoryComesInPagesAndThenWhatHasChanged) {
  Serve();
  for (int i = 0; i < 10000; ++i) view_.AddFrame(FrameAt(2 * i));
  std::int64_t first_version = -1, from = -1, version = -1;
  std::vector<std::int64_t> indices;
  std::vector<double> x;
  const auto fetch = [&](std::int64_t since) {
    const auto answer = Client().Get(
        ("/api/trajectory?since=" + std::to_string(since) + "&from=" + std::to_string(from)));
    ASSERT_EQ(answer->status, 200);
    WireReader bytes(answer->body);
    EXPECT_EQ(bytes.Magic(), "LTR2");
    const auto poses = bytes.Get<std::uint32_t>();
    EXPECT_EQ(bytes.Get<std::uint64_t>(), std::stoull(view_.run_id(), nullptr, 16));
    version = bytes.Get<std::int64_t>();
    from = bytes.Get<std::int64_t>();
    for (std::uint32_t i = 0; i < poses; ++i) {
      indices.push_back(bytes.Get<std::int64_t>());
      EXPECT_EQ(bytes.Get<std::int64_t>(), indices.back() * 100000000);
      x.push_back(bytes.Get<double>());
      for (int k = 0; k < 2; ++k) EXPECT_EQ(bytes.Get<double>(), 0.0);
      for (int k = 0; k < 3; ++k) EXPECT_EQ(bytes.Get<float>(), 0.0F);
      EXPECT_EQ(bytes.Get<float>(), 1.0F);
      EXPECT_EQ(bytes.Get<std::int64_t>(), 0);
    }
    EXPECT_TRUE(bytes.AtEnd());
  };
  fetch(-1);
  first_version = version;
  EXPECT_EQ(indices.size(), 8192U);
  EXPECT_EQ(from, 2 * 8192);
  fetch(-1);
  EXPECT_EQ(from, -1);
  EXPECT_EQ(indices.size(), 10000U);
  EXPECT_EQ(indices.back(), 19998);
  indices.clear();
  x.clear();
  view_.RevisePoses({PoseAt(19990, -5.0), PoseAt(19991, 1.0), PoseAt(19998, -6.0)});
  view_.AddFrame(FrameAt(20000));
  fetch(first_version);
  EXPECT_THAT(indices, ElementsAre(19990, 19998, 20000));
  EXPECT_THAT(x, ElementsAre(-5.0, -6.0, 20000.0));
}

TEST_F(HttpServerTest, OpenPosesAreWantedWhileSomebodyAsksAndFinalOnesAreNeverMissed) {
  Serve();
  EXPECT_FALSE(view_.PosesWanted());
  view_.AddFrame(FrameAt(1));
  view_.RevisePoses({PoseAt(1, 7.0)});
  view_.RevisePoses({PoseAt(2, 8.0)});  // final before it is durable
  view_.AddFrame(FrameAt(2));
  Client().Get("/api/trajectory");
  EXPECT_TRUE(view_.PosesWanted());
  const TrajectoryPage page = view_.Trajectory(-1, -1);
  ASSERT_EQ(page.poses.size(), 2U);
  EXPECT_EQ(page.poses[0].T_world_lidar.t.x(), 7.0);
  EXPECT_EQ(page.poses[1].T_world_lidar.t.x(), 8.0);
  // What stays where it was is no news.
  view_.RevisePoses({PoseAt(1, 7.0), PoseAt(2, 9.0)});
  EXPECT_EQ(view_.Trajectory(page.version, -1).poses.size(), 1U);
}

TEST_F(HttpServerTest, ScanIsEmptyUntilSomebodyAsksAndOneIsThere) {
  Serve();
  EXPECT_FALSE(view_.ScanWanted());
  WireReader none(Client().Get("/api/scan")->body);
  EXPECT_EQ(none.Magic(), "LSC2");
  EXPECT_EQ(none.Get<std::uint32_t>(), 0U);
  none.Get<std::uint64_t>();
  EXPECT_EQ(none.Get<std::int64_t>(), -1);
  EXPECT_TRUE(view_.ScanWanted());
  view_.SetScan({7, {1e6, 2.0, 3.0}, {{1.0F, 2.0F, 3.0F}, {4.0F, 5.0F, 6.0F}}, 3});
  WireReader scan(Client().Get("/api/scan")->body);
  scan.Magic();
  EXPECT_EQ(scan.Get<std::uint32_t>(), 2U);
  scan.Get<std::uint64_t>();
  EXPECT_EQ(scan.Get<std::int64_t>(), 7);
  EXPECT_EQ(scan.Get<double>(), 1e6);
  scan.Get<double>();
  scan.Get<double>();
  EXPECT_EQ(scan.Get<std::int64_t>(), 3);
  for (int i = 1; i <= 6; ++i) EXPECT_EQ(scan.Get<float>(), static_cast<float>(i));
  EXPECT_TRUE(scan.AtEnd());
}

TEST_F(HttpServerTest, MapPagesHoldCellsOfSurfels) {
  Serve();
  const auto answer =
      Client().Get("/api/map?x=1.5&y=-2&z=3e1&radius=100&page=0&newer_than=9&piece=4");
  ASSERT_EQ(answer->status, 200);
  EXPECT_EQ(last_query_.centre, Eigen::Vector3d(1.5, -2.0, 30.0));
  EXPECT_EQ(last_query_.radius_m, 100.0);
  EXPECT_EQ(last_query_.newer_than, 9);
  EXPECT_EQ(last_query_.piece, 4);
  WireReader map(answer->body);
  EXPECT_EQ(map.Magic(), "LMP1");
  EXPECT_EQ(map.Get<std::uint32_t>(), 2U);
  map.Get<std::uint64_t>();
  EXPECT_EQ(map.Get<std::int64_t>(), 17);
  EXPECT_EQ(map.Get<double>(), 2.0);
  EXPECT_EQ(map.Get<std::uint32_t>(), 1U);
  EXPECT_EQ(map.Get<std::uint32_t>(), 3000000000U);
  for (const int i : {-1, 2, 3, 1}) EXPECT_EQ(map.Get<std::int32_t>(), i);
  for (const float x : {0.5F, 0.25F, 1.0F}) EXPECT_EQ(map.Get<float>(), x);
  for (const int n : {0, 0, -127, 0}) EXPECT_EQ(map.Get<std::int8_t>(), n);
  EXPECT_EQ(map.Get<std::uint16_t>(), 400);
  EXPECT_EQ(map.Get<std::uint16_t>(), 100);
  EXPECT_EQ(map.Get<std::int32_t>(), 12);
  for (const int i : {0, 0, 0, 0}) EXPECT_EQ(map.Get<std::int32_t>(), i);
  EXPECT_TRUE(map.AtEnd());
}

TEST_F(HttpServerTest, BadParametersAreNamed) {
  Serve();
  const auto refused = [&](const std::string& path, const char* name) {
    const auto answer = Client().Get(path.c_str());
    EXPECT_EQ(answer->status, 400) << path;
    EXPECT_THAT(Json::parse(answer->body)["error"].get<std::string>(), HasSubstr(name)) << path;
  };
  refused("/api/map", "x must be");
  refused("/api/map?x=0&y=0&z=0", "radius");
  refused("/api/map?x=nan&y=0&z=0&radius=1", "x must be");
  refused("/api/map?x=0&y=1e99&z=0&radius=1", "y must be");
  refused("/api/map?x=0&y=0&z=0&radius=-1", "radius");
  refused("/api/map?x=0&y=0&z=0&radius=1&page=-1", "page");
  refused("/api/map?x=0&y=0&z=0&radius=1&page=4294967296", "page");
  refused("/api/map?x=0&y=0&z=0&radius=1&newer_than=x", "newer_than");
  refused("/api/trajectory?since=1.5", "since");
  refused("/api/trajectory?from=99999999999999999999", "from");
  refused("/api/timings?since=", "since");
}

TEST_F(HttpServerTest, AMapThatThrowsIsAnAnswerToo) {
  HttpParts parts = Parts();
  parts.map = [](const MapQuery&) -> MapPage { throw std::runtime_error("tile 3 is damaged"); };
  server_ = std::make_unique<HttpServer>(*ParseHttpAddress("127.0.0.1:0"), parts);
  const auto answer = Client().Get("/api/map?x=0&y=0&z=0&radius=1");
  EXPECT_EQ(answer->status, 500);
  EXPECT_THAT(answer->body, HasSubstr("tile 3 is damaged"));
  EXPECT_EQ(Client().Get("/api/status")->status, 200);
}

// name{labels} value, and the two comments before each name, in the form that Prometheus reads.
TEST_F(HttpServerTest, MetricsAreWhatPrometheusReads) {
  Serve();
  LiveStatus status;
  status.frames = 12345678901;
  status.verdict.grade = RunVerdict::Grade::kDoubtful;
  status.checkpoint = LiveStatus::Checkpoint{};
  view_.SetStatus(status);
  const auto answer = Client().Get("/metrics");
  ASSERT_EQ(answer->status, 200);
  EXPECT_THAT(answer->get_header_value("Content-Type"), StartsWith("text/plain; version=0.0.4"));
  EXPECT_EQ(answer->body.back(), '\n');
  static const std::regex kHelp(R"(# HELP ([a-z_0-9]+) \S.*\.)");
  static const std::regex kType(R"(# TYPE ([a-z_0-9]+) (counter|gauge))");
  static const std::regex kSample(R"(([a-z_0-9]+) (\S+))");
  std::set<std::string> names;
  std::map<std::string, double> values;
  std::istringstream lines(answer->body);
  for (std::string help, type, sample; std::getline(lines, help);) {
    ASSERT_TRUE(std::getline(lines, type) && std::getline(lines, sample)) << help;
    std::smatch h, t, s;
    ASSERT_TRUE(std::regex_match(help, h, kHelp)) << help;
    ASSERT_TRUE(std::regex_match(type, t, kType)) << type;
    ASSERT_TRUE(std::regex_match(sample, s, kSample)) << sample;
    EXPECT_EQ(h[1], t[1]);
    EXPECT_EQ(h[1], s[1]);
    const std::string name = s[1];
    EXPECT_THAT(name, StartsWith("lamina_"));
    EXPECT_TRUE(names.insert(name).second) << name << " is there twice";
    const bool total = std::regex_search(name, std::regex("_total$"));
    EXPECT_EQ(t[2] == "counter", total) << name;
    std::size_t used = 0;
    values[name] = std::stod(s[2], &used);
    EXPECT_EQ(used, s[2].str().size()) << sample;
  }
  EXPECT_EQ(values.at("lamina_frames_total"), 12345678901.0);
  EXPECT_EQ(values.count("lamina_checkpoint_age_seconds"), 1U);
  EXPECT_EQ(values.at("lamina_verdict"), 1.0);
  EXPECT_GT(values.size(), 20U);
}

TEST_F(HttpServerTest, HealthIsTheMappingThreadsSignOfLife) {
  Serve();
  EXPECT_EQ(Client().Get("/healthz")->status, 200);
  EXPECT_EQ(Client().Get("/healthz")->body, "ok\n");
  LiveStatus status;
  status.failure = "the disk is full";
  view_.SetStatus(status);
  EXPECT_EQ(Client().Get("/healthz")->status, 503);
  EXPECT_EQ(Client().Get("/healthz")->body, "the disk is full\n");
  view_.SetStatus({});
  EXPECT_EQ(view_.Ailment(std::chrono::seconds(3600)), "");
  EXPECT_THAT(view_.Ailment(std::chrono::seconds(-1)), HasSubstr("no sign of life"));
}

}  // namespace
}  // namespace lamina
