// The daemon's HTTP server: the live page, and the state of the daemon for programs.
//
//   GET  /                 the live page; further files of it and of three.js from disk
//   GET  /api/status       JSON: state, frames, rate, lag, queue, map, last pose, ...
//   GET  /api/timings      ?since=N         JSON: stage times of frames N and newer, 600 at most
//   GET  /api/trajectory   ?since=V&from=I  binary: poses changed after version V, from index I on
//   GET  /api/scan                          binary: the current scan
//   GET  /api/map          ?x&y&z&radius&page&newer_than   binary: surfels near a place, paged
//   GET  /metrics          text for Prometheus
//   GET  /healthz          200 "ok", or 503 and why not
//   POST /api/checkpoint   202; needs the token
//   POST /api/stop         202; needs the token
//
// The binary forms are those of tools/watch/live/wire.h. Errors are JSON, {"error": "..."}: 400 bad
// parameter or no Host, 401 no or wrong token, 403 foreign Host, 404, 405 with Allow, 413, 500.
//
// The token, `Authorization: Bearer TOKEN`, is a fresh random one each time, in the file `token` of
// the session's folder, mode 0600. Nothing but the two POST routes has an effect. Answers carry no
// CORS headers, so no other site's script can read them; bound to a loopback address, the server
// answers only requests whose Host is a loopback name, so that no foreign name can be pointed at
// it (DNS rebinding).
//
// Handlers run on threads of the server, several at once: `map`, `checkpoint` and `stop` must be
// thread-safe, and the last two only note the wish and return. The mapping thread meets the server
// in LiveView's short locks alone; a client may be as slow as it likes (tools/http/listener.h).
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "tools/http/listener.h"
#include "tools/http/web_assets.h"
#include "tools/watch/live/view.h"
#include "tools/watch/live/wire.h"

namespace lamina {

struct HttpParts {
  LiveView* view = nullptr;  // must outlive the server
  std::function<MapPage(const MapQuery&)> map;
  std::function<void()> checkpoint, stop;
  std::string session;  // folder for `token`
  WebFolders web = FindWebFolders();
};

struct HttpLimits {
  std::size_t connections = 24;  // served at once; more wait
  std::size_t request_bytes = 65536;
  std::chrono::milliseconds idle{3000};       // of a connection that is kept open
  std::chrono::milliseconds request{10000};   // from its first byte to its last
  std::chrono::milliseconds response{60000};  // a phone may take long for a page of the map
  std::chrono::seconds stale{60};             // silence of the mapping thread that is ill health
};

class HttpServer {
 public:
  // Listens, writes the token and serves from then on. Throws OptionError, OutputError.
  HttpServer(const HttpAddress& address, HttpParts parts, const HttpLimits& limits = {});
  // Ends within a moment, whatever clients do.
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  int port() const;
  // "http://127.0.0.1:8090/", to be told to the user.
  std::string url() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lamina
