#include "tools/watch/live/server.h"

#include <fmt/format.h>
#include <httplib.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "tools/http/token.h"
#include "tools/watch/live/text.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using httplib::Request;
using httplib::Response;

constexpr char kJson[] = "application/json";
constexpr char kBinary[] = "application/octet-stream";
constexpr double kFarthestM = 1e7;

void SetError(Response* response, int status, const std::string& what) {
  response->status = status;
  response->set_content(nlohmann::json{{"error", Printable(what)}}.dump(), kJson);
}

// A request that cannot be answered, for a reason that the client is told.
struct BadRequest {
  std::string what;
};

std::int64_t IntegerParam(const Request& request, const char* name, std::int64_t fallback) {
  if (!request.has_param(name)) return fallback;
  const std::string text = request.get_param_value(name);
  std::int64_t value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc() && rest == end) return value;
  throw BadRequest{fmt::format("{} must be a whole number", name)};
}

double NumberParam(const Request& request, const char* name, double low, double high) {
  const std::string text = request.get_param_value(name);
  double value = 0.0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (error == std::errc() && rest == end && value >= low && value <= high) return value;
  throw BadRequest{fmt::format("{} must be a number in [{}, {}]", name, low, high)};
}

MapQuery QueryOf(const Request& request) {
  MapQuery query;
  for (int i = 0; i < 3; ++i) {
    constexpr const char* kNames[] = {"x", "y", "z"};
    query.centre[i] = NumberParam(request, kNames[i], -kFarthestM, kFarthestM);
  }
  query.radius_m = NumberParam(request, "radius", 0.0, kFarthestM);
  const std::int64_t page = IntegerParam(request, "page", 0);
  if (page < 0 || page > std::numeric_limits<std::uint32_t>::max()) {
    throw BadRequest{"page must be 0, or what the page before says"};
  }
  query.page = static_cast<std::uint32_t>(page);
  query.newer_than = IntegerParam(request, "newer_than", -1);
  query.piece = IntegerParam(request, "piece", 0);
  return query;
}

// The name in "NAME", "NAME:PORT" or "[IPV6]:PORT".
std::string HostName(const std::string& host) {
  if (!host.empty() && host.front() == '[') return host.substr(0, host.find(']') + 1);
  return host.substr(0, host.find(':'));
}

bool IsLoopbackName(const std::string& name) {
  if (name == "localhost" || name == "[::1]") return true;
  // 127.0.0.0/8 in numbers; 127.evil.example is a name like any other.
  return name.rfind("127.", 0) == 0 && name.find_first_not_of("0123456789.") == std::string::npos;
}

// The page's own files, by route; what is not listed here is not served.
struct PageFile {
  const char* route;
  const char* type;
  bool of_three;
  const char* file;
};
constexpr PageFile kPageFiles[] = {
    {"/", "text/html; charset=utf-8", false, "index.html"},
    {"/style.css", "text/css; charset=utf-8", false, "style.css"},
    {"/wire.js", "text/javascript; charset=utf-8", false, "wire.js"},
    {"/surfels.js", "text/javascript; charset=utf-8", false, "surfels.js"},
    {"/viewer.js", "text/javascript; charset=utf-8", false, "viewer.js"},
    {"/charts.js", "text/javascript; charset=utf-8", false, "charts.js"},
    {"/verdict.js", "text/javascript; charset=utf-8", false, "verdict.js"},
    {"/live.js", "text/javascript; charset=utf-8", false, "live.js"},
    {"/three.min.js", "text/javascript; charset=utf-8", true, "three.min.js"},
    {"/OrbitControls.js", "text/javascript; charset=utf-8", true,
     "examples/js/controls/OrbitControls.js"},
};

void ServeFile(const WebFolders& web, const PageFile& file, Response* response) {
  const std::string& folder = file.of_three ? web.three : web.page;
  const std::string path = (fs::path(folder) / file.file).string();
  std::ifstream stream(path, std::ios::binary);
  if (folder.empty() || !stream) {
    return SetError(response, 404,
                    fmt::format("{} is not installed{}", file.file,
                                file.of_three ? " (Debian: apt install libjs-three)"
                                              : "; the API is at /api/status"));
  }
  response->set_content({std::istreambuf_iterator<char>(stream), {}}, file.type);
}

// httplib's view of a connection.
class HttpStream : public httplib::Stream {
 public:
  explicit HttpStream(Connection* connection, std::size_t most_bytes)
      : connection_(connection), bytes_left_(most_bytes) {}

  bool is_readable() const override { return connection_->Wait(POLLIN); }
  bool is_writable() const override { return connection_->Wait(POLLOUT); }
  ssize_t read(char* to, size_t size) override {
    // Whatever its form, a request beyond the limit ends here.
    if (bytes_left_ == 0) return -1;
    if (next_ == buffered_) {
      buffered_ = next_ = 0;
      const std::ptrdiff_t got = connection_->Read(buffer_.data(), buffer_.size());
      if (got <= 0) return got;
      buffered_ = static_cast<std::size_t>(got);
    }
    const std::size_t taken = std::min({size, buffered_ - next_, bytes_left_});
    std::copy_n(buffer_.data() + next_, taken, to);
    next_ += taken;
    bytes_left_ -= taken;
    return static_cast<ssize_t>(taken);
  }
  // All of it or -1: not every caller in httplib minds a part.
  ssize_t write(const char* from, size_t size) override {
    for (std::size_t done = 0; done < size;) {
      const std::ptrdiff_t sent = connection_->Write(from + done, size - done);
      if (sent < 0) return -1;
      done += static_cast<std::size_t>(sent);
    }
    return static_cast<ssize_t>(size);
  }
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}
  int socket() const override { return connection_->fd(); }

  // Waits for the next request to begin, which may be so many bytes long.
  bool NextRequest(std::size_t most_bytes) {
    bytes_left_ = most_bytes;
    return next_ < buffered_ || connection_->Wait(POLLIN);
  }

 private:
  Connection* connection_;
  std::size_t bytes_left_;
  std::array<char, 8192> buffer_;
  std::size_t buffered_ = 0, next_ = 0;
};

}  // namespace

// httplib reads requests, writes answers and knows HTTP; sockets and threads are the listener's.
class HttpServer::Impl : private httplib::Server {
 public:
  Impl(const HttpAddress& address, HttpParts parts, const HttpLimits& limits)
      : address_(address),
        parts_(std::move(parts)),
        limits_(limits),
        token_(RandomHex(16)),
        listener_(address) {
    AddFiles();
    AddReadings();
    AddWishes();
    set_pre_routing_handler([this](const Request& request, Response& response) {
      Answer(request, &response);
      return HandlerResponse::Handled;
    });
    set_default_headers(
        {{"Cache-Control", "no-store"},
         {"X-Content-Type-Options", "nosniff"},
         {"Referrer-Policy", "no-referrer"},
         {"Content-Security-Policy",
          "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
          "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"}});
    WriteToken((fs::path(parts_.session) / "token").string(), token_);
    listener_.Start(limits_.connections, [this](Connection& c) { Serve(&c); });
  }
  ~Impl() override { listener_.Stop(); }

  const HttpAddress& address() const { return address_; }
  int port() const { return listener_.port(); }

 private:
  using Answerer = std::function<void(const Request&, Response*)>;
  struct Route {
    bool post = false;
    Answerer answer;
  };

  void AddFiles() {
    for (const PageFile& file : kPageFiles) {
      routes_[file.route] = {false, [this, &file](const Request&, Response* response) {
                               ServeFile(parts_.web, file, response);
                             }};
    }
  }

  void AddReadings() {
    const LiveView& view = *parts_.view;
    const auto get = [&](const char* path, Answerer answer) {
      routes_[path] = {false, std::move(answer)};
    };
    get("/api/status", [&view](const Request&, Response* response) {
      response->set_content(StatusJson(view.Report()), kJson);
    });
    get("/api/timings", [&view](const Request& request, Response* response) {
      const std::int64_t since = std::max<std::int64_t>(0, IntegerParam(request, "since", 0));
      response->set_content(TimingsJson(view.Timings(static_cast<std::uint64_t>(since))), kJson);
    });
    get("/api/trajectory", [&view](const Request& request, Response* response) {
      const TrajectoryPage page =
          view.Trajectory(IntegerParam(request, "since", -1), IntegerParam(request, "from", -1));
      response->set_content(EncodeTrajectory(page, view.run_id()), kBinary);
    });
    get("/api/scan", [&view](const Request&, Response* response) {
      response->set_content(EncodeScan(view.Scan().get(), view.run_id()), kBinary);
    });
    get("/api/map", [this, &view](const Request& request, Response* response) {
      response->set_content(EncodeMap(parts_.map(QueryOf(request)), view.run_id()), kBinary);
    });
    get("/metrics", [&view](const Request&, Response* response) {
      response->set_content(PrometheusText(view.Report()), "text/plain; version=0.0.4");
    });
    get("/healthz", [this, &view](const Request&, Response* response) {
      const std::string ailment = view.Ailment(limits_.stale);
      response->status = ailment.empty() ? 200 : 503;
      response->set_content((ailment.empty() ? "ok" : Printable(ailment)) + "\n", "text/plain");
    });
  }

  void AddWishes() {
    const auto post = [this](const char* path, const std::function<void()>& wish) {
      routes_[path] = {true, [this, wish](const Request& request, Response* response) {
                         if (!HasToken(request)) {
                           response->set_header("WWW-Authenticate", "Bearer");
                           return SetError(response, 401,
                                           "needs Authorization: Bearer TOKEN, see "
                                           "the file `token` of the session");
                         }
                         wish();
                         response->status = 202;
                         response->set_content(R"({"accepted":true})", kJson);
                       }};
    };
    post("/api/checkpoint", parts_.checkpoint);
    post("/api/stop", parts_.stop);
  }

  bool HasToken(const Request& request) const {
    constexpr std::string_view kScheme = "Bearer ";
    const std::string given = request.get_header_value("Authorization");
    return request.get_header_value_count("Authorization") == 1 && given.rfind(kScheme, 0) == 0 &&
           SameSecret(std::string_view(given).substr(kScheme.size()), token_);
  }

  void Answer(const Request& request, Response* response) {
    try {
      if (MayAsk(request, response)) Find(request, response);
    } catch (const BadRequest& bad) {
      SetError(response, 400, bad.what);
    } catch (const std::exception& error) {
      SetError(response, 500, error.what());
    }
  }

  bool MayAsk(const Request& request, Response* response) const {
    if (request.get_header_value_count("Host") != 1) {
      SetError(response, 400, "a request has one Host");
      return false;
    }
    if (!listener_.loopback() || IsLoopbackName(HostName(request.get_header_value("Host")))) {
      return true;
    }
    SetError(response, 403, "Host must be localhost or 127.0.0.1 here");
    return false;
  }

  void Find(const Request& request, Response* response) {
    const auto route = routes_.find(request.path);
    if (route == routes_.end()) return SetError(response, 404, "nothing is here");
    const bool get = request.method == "GET" || request.method == "HEAD";
    if (route->second.post ? request.method != "POST" : !get) {
      response->set_header("Allow", route->second.post ? "POST" : "GET, HEAD");
      return SetError(response, 405, request.method + " is not for " + request.path);
    }
    if (BodyBytes(request) > limits_.request_bytes) {
      return SetError(response, 413, fmt::format("at most {} bytes", limits_.request_bytes));
    }
    route->second.answer(request, response);
  }

  static std::uint64_t BodyBytes(const Request& request) {
    const std::string text = request.get_header_value("Content-Length");
    if (text.empty()) return 0;
    std::uint64_t bytes = 0;
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, bytes);
    if (error == std::errc::result_out_of_range) return std::numeric_limits<std::uint64_t>::max();
    if (error == std::errc() && rest == end) return bytes;
    throw BadRequest{"Content-Length must be a whole number"};
  }

  // One request after the other, until either side has had enough.
  void Serve(Connection* connection) {
    HttpStream stream(connection, limits_.request_bytes);
    for (bool keep = true; keep;) {
      connection->SetDeadline(limits_.idle);
      if (!stream.NextRequest(limits_.request_bytes)) return;
      connection->SetDeadline(limits_.request);
      // No route reads a body, so what follows one is not looked for. A request that cannot be
      // parsed never gets to `admit`, and is the last one, too.
      keep = false;
      const auto admit = [&](Request& request) {
        const bool body = request.method != "GET" && request.method != "HEAD";
        keep = !body && !request.has_header("Content-Length") &&
               !request.has_header("Transfer-Encoding") && listener_.HasFreeThread();
        // Parts of a file, thousands of them overlapping, would be a cheap way to fill memory.
        request.ranges.clear();
        // httplib would compress what the browser lets it, at brotli's best: of three.js that takes
        // a second of a core, which is the mapping's, for each page that is opened.
        request.headers.erase("Accept-Encoding");
        connection->SetDeadline(limits_.response);
      };
      bool closed = false;
      if (!process_request(stream, !listener_.HasFreeThread(), closed, admit)) break;
      keep = keep && !closed;
    }
    connection->FinishWriting();
  }

  const HttpAddress address_;
  const HttpParts parts_;
  const HttpLimits limits_;
  const std::string token_;
  std::map<std::string, Route> routes_;
  HttpListener listener_;
};

HttpServer::HttpServer(const HttpAddress& address, HttpParts parts, const HttpLimits& limits)
    : impl_(std::make_unique<Impl>(address, std::move(parts), limits)) {}

HttpServer::~HttpServer() = default;

int HttpServer::port() const { return impl_->port(); }

std::string HttpServer::url() const {
  const std::string& host = impl_->address().host;
  return host.find(':') == std::string::npos ? fmt::format("http://{}:{}/", host, port())
                                             : fmt::format("http://[{}]:{}/", host, port());
}

}  // namespace lamina
