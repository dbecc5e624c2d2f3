// Whom the server answers: tokens, methods, hosts, other sites.
#include <gmock/gmock.h>
#include <httplib.h>
#include <sys/stat.h>

#include <regex>

#include "tests/tools/watch/live/live_server_fixture.h"
#include "tools/http/token.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::StartsWith;

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

}  // namespace
}  // namespace lamina
