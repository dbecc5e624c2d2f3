#include "tools/http/listener.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstring>
#include <memory>
#include <utility>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr int kBacklog = 128;
constexpr int kPauseMs = 50;
// What FinishWriting takes in at most, and for how long.
constexpr std::size_t kLingerBytes = std::size_t{1} << 20;
constexpr std::chrono::milliseconds kLingerTime{500};

[[noreturn]] void FailToListen(const HttpAddress& address, int reason) {
  throw OutputError(fmt::format("cannot listen on {}:{}: {}{}", address.host, address.port,
                                std::strerror(reason),
                                reason == EADDRINUSE ? " (another program serves there)" : ""));
}

using Addresses = std::unique_ptr<addrinfo, decltype(&freeaddrinfo)>;

Addresses Resolve(const HttpAddress& address) {
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(address.host.c_str(), std::to_string(address.port).c_str(), &hints, &found);
  if (error != 0) {
    throw OptionError(
        fmt::format("--http: host {} is not known: {}", address.host, gai_strerror(error)));
  }
  return {found, freeaddrinfo};
}

bool IsLoopback(const sockaddr* address) {
  if (address->sa_family == AF_INET) {
    const auto* v4 = reinterpret_cast<const sockaddr_in*>(address);
    return (ntohl(v4->sin_addr.s_addr) >> 24U) == 127;
  }
  const auto* v6 = reinterpret_cast<const sockaddr_in6*>(address);
  return address->sa_family == AF_INET6 && IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr);
}

// The port that the system chose for 0.
int BoundPort(int socket) {
  sockaddr_storage bound{};
  socklen_t size = sizeof(bound);
  if (getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size) != 0) return 0;
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6*>(&bound)->sin6_port
                                           : reinterpret_cast<sockaddr_in*>(&bound)->sin_port);
}

enum class Waited { kReady, kTimeIsOver, kStopped };

// Waits for `fd` to have one of `events`, or for the stop event; negative time: for ever.
Waited WaitFor(int fd, short events, int stop_fd, int timeout_ms) {
  std::array<pollfd, 2> fds{{{fd, events, 0}, {stop_fd, POLLIN, 0}}};
  const int ready = poll(fds.data(), fds.size(), timeout_ms);
  if (ready > 0 && fds[1].revents != 0) return Waited::kStopped;
  return ready > 0 ? Waited::kReady : Waited::kTimeIsOver;
}

}  // namespace

std::optional<HttpAddress> ParseHttpAddress(const std::string& text) {
  if (text == "off") return std::nullopt;
  const std::size_t colon = text.rfind(':');
  const auto fail = [&]() -> std::optional<HttpAddress> {
    throw OptionError(fmt::format(
        "--http is '{}', must be HOST:PORT with a port of 0 to 65535 (IPv6: [HOST]:PORT), or off",
        text));
  };
  if (colon == std::string::npos || colon == 0) return fail();
  HttpAddress address;
  address.host = text.substr(0, colon);
  const bool brackets = address.host.front() == '[' && address.host.back() == ']';
  if (brackets) address.host = address.host.substr(1, address.host.size() - 2);
  if (address.host.empty() || (!brackets && address.host.find(':') != std::string::npos)) {
    return fail();
  }
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, address.port);
  if (error != std::errc() || rest != end || address.port < 0 || address.port > 65535) {
    return fail();
  }
  return address;
}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(fd_, other.fd_);
  return *this;
}

Descriptor::~Descriptor() {
  if (fd_ >= 0) close(fd_);
}

bool Connection::Wait(short events) const {
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline_ - Clock::now());
  if (left.count() <= 0) return false;
  const auto most = std::chrono::milliseconds(std::chrono::hours(1));
  return WaitFor(fd(), events, stop_fd_, static_cast<int>(std::min(left, most).count())) ==
         Waited::kReady;
}

std::ptrdiff_t Connection::Read(char* to, std::size_t size) {
  for (;;) {
    const ssize_t got = recv(fd(), to, size, 0);
    if (got >= 0) return got;
    if (errno == EINTR) continue;
    if (errno != EAGAIN || !Wait(POLLIN)) return -1;
  }
}

std::ptrdiff_t Connection::Write(const char* from, std::size_t size) {
  for (;;) {
    const ssize_t sent = send(fd(), from, size, MSG_NOSIGNAL);
    if (sent >= 0) return sent;
    if (errno == EINTR) continue;
    if (errno != EAGAIN || !Wait(POLLOUT)) return -1;
  }
}

void Connection::FinishWriting() {
  shutdown(fd(), SHUT_WR);
  SetDeadline(kLingerTime);
  std::array<char, 4096> ignored;
  for (std::size_t taken = 0; taken < kLingerBytes;) {
    const std::ptrdiff_t got = Read(ignored.data(), ignored.size());
    if (got <= 0) return;
    taken += static_cast<std::size_t>(got);
  }
}

HttpListener::HttpListener(const HttpAddress& address)
    : stop_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (stop_.get() < 0) FailToListen(address, errno);
  const Addresses found = Resolve(address);
  int reason = EADDRNOTAVAIL;
  for (const addrinfo* a = found.get(); a != nullptr; a = a->ai_next) {
    Descriptor socket(
        ::socket(a->ai_family, a->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, a->ai_protocol));
    // A daemon that starts again must not wait until the system has forgotten its old connections.
    const int on = 1;
    setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    if (socket.get() >= 0 && bind(socket.get(), a->ai_addr, a->ai_addrlen) == 0 &&
        listen(socket.get(), kBacklog) == 0) {
      port_ = BoundPort(socket.get());
      loopback_ = IsLoopback(a->ai_addr);
      socket_ = std::move(socket);
      return;
    }
    reason = errno;
  }
  FailToListen(address, reason);
}

void HttpListener::Start(std::size_t threads, const std::function<void(Connection&)>& serve) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  free_ = threads;
  for (std::size_t i = 0; i < threads; ++i) {
    threads_.emplace_back([this, serve] { Accept(serve); });
  }
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

void HttpListener::Accept(const std::function<void(Connection&)>& serve) {
  while (WaitFor(socket_.get(), POLLIN, stop_.get(), -1) != Waited::kStopped) {
    Descriptor socket(accept4(socket_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (socket.get() < 0) {
      // Another thread was quicker, or the client has gone. Or there are no more descriptors: then
      // the connection would be offered again at once, and again.
      if (errno != EAGAIN) WaitFor(-1, 0, stop_.get(), kPauseMs);
      continue;
    }
    const int on = 1;
    setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
    --free_;
    Connection connection(std::move(socket), stop_.get());
    serve(connection);
    ++free_;
  }
}

void HttpListener::Stop() {
  const std::uint64_t one = 1;
  if (write(stop_.get(), &one, sizeof(one)) < 0) return;
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace lamina
