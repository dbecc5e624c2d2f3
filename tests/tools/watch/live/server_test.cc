// The server over real sockets, fed by a board and a map of the test's own.
#include "tools/watch/live/server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <future>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "core/base/error.h"
#include "tests/support/files/io_test_files.h"
#include "tools/http/token.h"

namespace lamina {
namespace {

using Json = nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

LivePose PoseAt(std::int64_t index, double x) {
  return {index, index * 100000000, SE3(Eigen::Quaterniond::Identity(), {x, 0.0, 0.0})};
}

LiveFrame FrameAt(std::int64_t index) {
  LiveFrame frame{PoseAt(index, static_cast<double>(index)), {}};
  frame.times.lag_ms = static_cast<float>(index);
  return frame;
}

// The numbers of a binary answer, one after the other.
class WireReader {
 public:
  explicit WireReader(std::string bytes) : bytes_(std::move(bytes)) {}
  template <typename T>
  T Get() {
    T value{};
    if (next_ + sizeof(T) > bytes_.size()) throw std::out_of_range("the answer is too short");
    std::memcpy(&value, bytes_.data() + next_, sizeof(T));
    next_ += sizeof(T);
    return value;
  }
  std::string Magic() {
    next_ += 4;
    return bytes_.substr(next_ - 4, 4);
  }
  bool AtEnd() const { return next_ == bytes_.size(); }

 private:
  std::string bytes_;
  std::size_t next_ = 0;
};

class HttpServerTest : public FilesTest {
 protected:
  HttpParts Parts() {
    HttpParts parts;
    parts.view = &view_;
    parts.session = Path("");
    parts.checkpoint = [this] { ++checkpoints_; };
    parts.stop = [this] { ++stops_; };
    parts.map = [this](const MapQuery& query) {
      last_query_ = query;
      MapPage page;
      page.cell_size_m = 2.0;
      page.version = 17;
      page.next = query.page == 0 ? 3000000000U : 0U;
      Surfel s{{-1.5, 4.25, 7.0}, {0.0F, 0.0F, -1.0F}, {0.04F, 0.04F, 0.0001F}, 30};
      s.last_keyframe = 12;
      page.cells = {{-1, 2, 3, {s}}, {0, 0, 0, {}}};
      return page;
    };
    return parts;
  }

  void Serve(const HttpLimits& limits = {}) {
    server_ = std::make_unique<HttpServer>(*ParseHttpAddress("127.0.0.1:0"), Parts(), limits);
  }

  httplib::Client Client() const { return httplib::Client("127.0.0.1", server_->port()); }
  std::string Token() const {
    const std::string line = Bytes(Path("token"));
    return line.substr(0, line.find('\n'));
  }
  static httplib::Headers Bearer(const std::string& token) {
    return {{"Authorization", "Bearer " + token}};
  }

  // Sends bytes as they are, and returns everything that comes back until the server closes.
  std::string Raw(const std::string& bytes) const {
    const Descriptor socket = Connect();
    EXPECT_EQ(send(socket.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
    shutdown(socket.get(), SHUT_WR);
    std::string answer(65536, '\0');
    std::size_t have = 0;
    for (ssize_t got = 1; got > 0 && have < answer.size();) {
      got = recv(socket.get(), answer.data() + have, answer.size() - have, 0);
      if (got > 0) have += static_cast<std::size_t>(got);
    }
    answer.resize(have);
    return answer;
  }

  Descriptor Connect() const {
    Descriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(server_->port()));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(socket.get(), reinterpret_cast<sockaddr*>(&address), sizeof(address)), 0);
    return socket;
  }

  LiveView view_;
  std::atomic<int> checkpoints_{0}, stops_{0};
  MapQuery last_query_;
  std::unique_ptr<HttpServer> server_;
};

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

TEST_F(HttpServerTest, WishesNeedTheToken) {
  Serve();
  const std::string token = Token();
  EXPECT_TRUE(std::regex_match(token, std::regex("[0-9a-f]{32}"))) << token;
  struct stat status {};
  ASSERT_EQ(stat(Path("token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);

  const auto post = [&](const char* path, const httplib::Headers& headers) {
    return Client().Post(path, headers, "", "text/plain")->status;
  };
  EXPECT_EQ(post("/api/stop", {}), 401);
  EXPECT_EQ(post("/api/stop", Bearer("")), 401);
  EXPECT_EQ(post("/api/stop", Bearer(token.substr(1))), 401);
  EXPECT_EQ(post("/api/stop", Bearer(token + "0")), 401);
  EXPECT_EQ(post("/api/stop", {{"Authorization", token}}), 401);
  EXPECT_EQ(post("/api/stop", {{"Authorization", "Basic " + token}}), 401);
  EXPECT_EQ(post("/api/stop?token=", Bearer(std::string(32, '0'))), 401);
  EXPECT_EQ(post("/api/checkpoint", {}), 401);
  EXPECT_EQ(stops_ + checkpoints_, 0);
  EXPECT_EQ(post("/api/checkpoint", Bearer(token)), 202);
  EXPECT_EQ(checkpoints_, 1);
  EXPECT_EQ(stops_, 0);
  EXPECT_EQ(post("/api/stop", Bearer(token)), 202);
  EXPECT_EQ(stops_, 1);
  // As curl -X POST sends it: no body and no word about one.
  EXPECT_THAT(Raw("POST /api/stop HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer " + token +
                  "\r\n\r\n"),
              StartsWith("HTTP/1.1 202"));
  EXPECT_EQ(stops_, 2);
}

TEST_F(HttpServerTest, EachServerHasATokenOfItsOwn) {
  Serve();
  const std::string first = Token();
  server_.reset();
  chmod(Path("token").c_str(), 0644);
  Serve();
  EXPECT_NE(Token(), first);
  struct stat status {};
  ASSERT_EQ(stat(Path("token").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  EXPECT_EQ(Client().Post("/api/stop", Bearer(first), "", "text/plain")->status, 401);
}

TEST(HttpToken, SecretsAreTheSameOrNot) {
  EXPECT_TRUE(SameSecret("abc", "abc"));
  EXPECT_FALSE(SameSecret("abd", "abc"));
  EXPECT_FALSE(SameSecret("abcabc", "abc"));
  EXPECT_FALSE(SameSecret("", "abc"));
  EXPECT_FALSE(SameSecret("", ""));
}

TEST_F(HttpServerTest, OtherMethodsAreRefusedAndNamed) {
  Serve();
  for (const char* path : {"/api/stop", "/api/checkpoint"}) {
    const auto answer = Client().Get(path, Bearer(Token()));
    EXPECT_EQ(answer->status, 405);
    EXPECT_EQ(answer->get_header_value("Allow"), "POST");
  }
  for (const char* path : {"/", "/api/status", "/api/map", "/metrics"}) {
    EXPECT_EQ(Client().Post(path, "x", "text/plain")->status, 405);
    EXPECT_EQ(Client().Delete(path)->status, 405);
    EXPECT_EQ(Client().Put(path, "x", "text/plain")->get_header_value("Allow"), "GET, HEAD");
    EXPECT_EQ(Client().Options(path)->status, 405);
  }
  EXPECT_EQ(stops_ + checkpoints_, 0);
  const auto head = Client().Head("/api/status");
  EXPECT_EQ(head->status, 200);
  EXPECT_THAT(head->body, IsEmpty());
}

TEST_F(HttpServerTest, NothingButTheKnownFilesIsServed) {
  Serve();
  for (const char* path :
       {"/token", "/../token", "/..%2ftoken", "/%2e%2e/token", "/./../../etc/passwd", "/..\\token",
        "//etc/passwd", "/style.css/../../CMakeLists.txt", "/api", "/api/", "/api/status/",
        "/three.js", "/index.html%00.js", "/examples/js/controls/"}) {
    EXPECT_EQ(Client().Get(path)->status, 404) << path;
  }
  EXPECT_THAT(Raw("GET ../../../etc/passwd HTTP/1.1\r\nHost: localhost\r\n\r\n"),
              AllOf(StartsWith("HTTP/1.1 4"), Not(HasSubstr("root:"))));
}

TEST_F(HttpServerTest, NoTimeIsSpentOnCompression) {
  Serve();
  for (const char* path : {"/viewer.js", "/api/status", "/metrics"}) {
    const std::string answer = Raw(std::string("GET ") + path +
                                   " HTTP/1.1\r\nHost: localhost\r\nAccept-Encoding: gzip, br\r\n"
                                   "Connection: close\r\n\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
    EXPECT_THAT(answer, Not(HasSubstr("Content-Encoding"))) << path;
  }
}

TEST_F(HttpServerTest, APageThatIsNotInstalledSaysSo) {
  HttpParts parts = Parts();
  parts.web = {};
  server_ = std::make_unique<HttpServer>(*ParseHttpAddress("127.0.0.1:0"), parts);
  EXPECT_EQ(Client().Get("/")->status, 404);
  EXPECT_THAT(Client().Get("/")->body, HasSubstr("index.html is not installed"));
  EXPECT_THAT(Client().Get("/three.min.js")->body, HasSubstr("libjs-three"));
  EXPECT_EQ(Client().Get("/api/status")->status, 200);
}

TEST_F(HttpServerTest, ForeignHostsAreRefused) {
  Serve();
  const auto with_host = [&](const std::string& host) {
    return Raw("GET /api/status HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n")
        .substr(9, 3);
  };
  for (const char* good : {"localhost", "localhost:8090", "127.0.0.1", "127.0.0.1:1", "[::1]:80"}) {
    EXPECT_EQ(with_host(good), "200") << good;
  }
  for (const char* bad : {"evil.example", "evil.example:8090", "127.0.0.1.evil.example",
                          "localhost.evil.example", "127.evil.example", "[::2]", "192.168.0.1"}) {
    EXPECT_EQ(with_host(bad), "403") << bad;
  }
  EXPECT_THAT(Raw("GET / HTTP/1.1\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(Raw("GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n"),
              StartsWith("HTTP/1.1 400"));
}

TEST_F(HttpServerTest, NoOtherSiteMayRead) {
  Serve();
  const auto answer = Client().Get("/api/status", {{"Origin", "http://evil.example"}});
  EXPECT_FALSE(answer->has_header("Access-Control-Allow-Origin"));
  EXPECT_THAT(answer->get_header_value("Content-Security-Policy"), HasSubstr("default-src 'none'"));
  EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff");
}

TEST_F(HttpServerTest, LargeRequestsEnd) {
  Serve();
  const auto post = Client().Post("/api/stop", Bearer(Token()), std::string(100000, 'x'), "a/b");
  ASSERT_TRUE(post);
  EXPECT_EQ(post->status, 413);
  EXPECT_THAT(Raw("GET /" + std::string(10000, 'x') + " HTTP/1.1\r\nHost: localhost\r\n\r\n"),
              StartsWith("HTTP/1.1 4"));
  std::string headers = "GET / HTTP/1.1\r\nHost: localhost\r\n";
  for (int i = 0; i < 10000; ++i) headers += "X-" + std::to_string(i) + ": y\r\n";
  EXPECT_THAT(Raw(headers + "\r\n"), Not(HasSubstr(" 200 ")));
  EXPECT_THAT(Raw("\x16\x03\x01 nonsense\r\n\r\n"), StartsWith("HTTP/1.1 400"));
  EXPECT_EQ(stops_, 0);
  // A thousand overlapping parts are one whole.
  std::string ranges = "bytes=0-1";
  for (int i = 0; i < 1000; ++i) ranges += ",0-";
  const auto whole = Client().Get("/api/status", {{"Range", ranges}});
  EXPECT_EQ(whole->status, 200);
  EXPECT_EQ(Json::parse(whole->body)["state"], "starting");
}

TEST_F(HttpServerTest, ABodyIsNotTakenForTheNextRequest) {
  Serve();
  const std::string hidden =
      "POST /api/stop HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer " + Token() + "\r\n\r\n";
  const std::string answer = Raw("GET /api/status HTTP/1.1\r\nHost: localhost\r\nContent-Length: " +
                                 std::to_string(hidden.size()) + "\r\n\r\n" + hidden);
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(stops_, 0);
}

TEST_F(HttpServerTest, SilentClientsHoldNeitherOthersForLongNorTheEnd) {
  HttpLimits limits;
  limits.connections = 2;
  limits.request = std::chrono::milliseconds(200);
  Serve(limits);
  // Twice as many as there are threads, each in the middle of a request.
  std::vector<Descriptor> silent;
  for (int i = 0; i < 4; ++i) {
    silent.push_back(Connect());
    ASSERT_EQ(send(silent.back().get(), "GET /", 5, MSG_NOSIGNAL), 5);
  }
  httplib::Client client = Client();
  client.set_read_timeout(60);
  const auto answer = client.Get("/api/status");
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->status, 200);
  server_.reset();
}

TEST_F(HttpServerTest, StopsWhileClientsAreSilentAndMayStartAgainOnThePort) {
  HttpLimits limits;
  limits.request = limits.idle = limits.response = std::chrono::hours(1);
  Serve(limits);
  const int port = server_->port();
  const Descriptor silent = Connect(), idle = Connect(), deaf = Connect();
  ASSERT_EQ(send(silent.get(), "GET /", 5, MSG_NOSIGNAL), 5);
  view_.SetScan({1, Eigen::Vector3d::Zero(), std::vector<Eigen::Vector3f>(5000000)});
  const std::string request = "GET /api/scan HTTP/1.1\r\nHost: localhost\r\n\r\n";
  ASSERT_EQ(send(deaf.get(), request.data(), request.size(), MSG_NOSIGNAL),
            static_cast<ssize_t>(request.size()));
  char first = 0;
  ASSERT_EQ(recv(deaf.get(), &first, 1, 0), 1);  // The answer has begun, and will not be read on.
  ASSERT_EQ(Client().Get("/healthz")->status, 200);
  // Far less than the hour that each of them may still take.
  auto end = std::async(std::launch::async, [this] { server_.reset(); });
  ASSERT_EQ(end.wait_for(std::chrono::minutes(5)), std::future_status::ready);
  server_ = std::make_unique<HttpServer>(HttpAddress{"127.0.0.1", port}, Parts());
  EXPECT_EQ(Client().Get("/healthz")->status, 200);
}

TEST_F(HttpServerTest, ManyReadersBesideTheMappingThread) {
  Serve();
  std::atomic<bool> end{false};
  std::vector<std::future<int>> readers;
  for (int i = 0; i < 8; ++i) {
    readers.push_back(std::async(std::launch::async, [&, i] {
      httplib::Client client = Client();
      client.set_keep_alive(true);
      static const char* const kPaths[] = {"/api/status", "/api/trajectory", "/api/scan",
                                           "/metrics"};
      int answers = 0;
      while (!end || answers < 4) {
        const auto answer = client.Get(kPaths[(i + answers) % 4]);
        if (!answer || answer->status != 200) return -1;
        ++answers;
      }
      return answers;
    }));
  }
  for (int i = 0; i < 3000; ++i) {
    view_.AddFrame(FrameAt(i));
    view_.RevisePoses({PoseAt(i - 1, 0.5), PoseAt(i, 1.5)});
    view_.SetScan({i, Eigen::Vector3d::Zero(), std::vector<Eigen::Vector3f>(100)});
    LiveStatus status;
    status.last_error = "a message that is too long to live inside of a string object";
    view_.SetStatus(status);
  }
  end = true;
  for (auto& reader : readers) EXPECT_GT(reader.get(), 0);
}

TEST(LiveView, KeepsNewPosesInFullAndThinsOldOnes) {
  LiveView view(100);
  for (int i = 0; i < 5000; ++i) view.AddFrame(FrameAt(i));
  const TrajectoryPage page = view.Trajectory(-1, -1);
  ASSERT_LE(page.poses.size(), 200U);
  ASSERT_GT(page.poses.size(), 140U);
  EXPECT_EQ(page.poses.front().index, 0);
  for (std::size_t i = 1; i < page.poses.size(); ++i) {
    EXPECT_LT(page.poses[i - 1].index, page.poses[i].index);
    EXPECT_LE(page.poses[i].index - page.poses[i - 1].index, 128);
  }
  EXPECT_EQ(page.poses[page.poses.size() - 100].index, 4900);
  EXPECT_THROW(view.AddFrame(FrameAt(4999)), std::logic_error);
}

TEST(LiveView, TimingsAreTheNewest) {
  LiveView view;
  EXPECT_EQ(view.Timings(0).times.size(), 0U);
  for (int i = 0; i < 1000; ++i) view.AddFrame(FrameAt(i));
  EXPECT_EQ(view.Timings(0).first, 400U);
  EXPECT_EQ(view.Timings(0).times.size(), 600U);
  const TimingPage page = view.Timings(998);
  ASSERT_EQ(page.times.size(), 2U);
  EXPECT_EQ(page.times[0].lag_ms, 998.0F);
  EXPECT_EQ(view.Timings(5000).times.size(), 0U);
  EXPECT_EQ(view.Report().latency_median_ms, 700.0);
  EXPECT_EQ(view.Report().latency_p99_ms, 994.0);
}

}  // namespace
}  // namespace lamina
