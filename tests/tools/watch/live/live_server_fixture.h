// A live server over real sockets, fed by a board and a map of the test's own.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <httplib.h>
#include <sys/socket.h>

#include <atomic>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>

#include "tests/support/files/io_test_files.h"
#include "tools/watch/live/server.h"

namespace lamina {

inline LivePose PoseAt(std::int64_t index, double x) {
  return {index, index * 100000000, SE3(Eigen::Quaterniond::Identity(), {x, 0.0, 0.0})};
}

inline LiveFrame FrameAt(std::int64_t index) {
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

}  // namespace lamina
