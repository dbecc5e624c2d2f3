// Clients that are large, silent, or many.
#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/socket.h>

#include <atomic>
#include <future>
#include <nlohmann/json.hpp>

#include "tests/tools/watch/live/live_server_fixture.h"

namespace lamina {
namespace {

using Json = nlohmann::json;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

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

}  // namespace
}  // namespace lamina
