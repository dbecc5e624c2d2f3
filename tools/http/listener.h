// A TCP port, and a fixed number of threads that serve one connection each. No HTTP here.
//
// Whatever a client does, it holds one thread and a deadline at most: connections beyond the
// threads wait in the system's queue, every wait for a socket ends at the deadline or when the
// listener stops, so that Stop() returns at once even while clients are silent.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace lamina {

struct HttpAddress {
  std::string host;  // a name or a number; IPv6 without brackets
  int port = 0;      // 0: any that is free
};

// "HOST:PORT" or "[IPV6]:PORT"; nothing for "off". Throws OptionError.
std::optional<HttpAddress> ParseHttpAddress(const std::string& text);

// A file descriptor that is closed with its owner.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor();
  int get() const { return fd_; }

 private:
  int fd_;
};

// A connected socket whose waits end at a deadline.
class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  Connection(Descriptor socket, int stop_fd) : socket_(std::move(socket)), stop_fd_(stop_fd) {}

  void SetDeadline(Clock::duration from_now) { deadline_ = Clock::now() + from_now; }
  // Both return the bytes moved; 0 when the other side has closed (Read), -1 on an error, at the
  // deadline, and when the listener stops.
  std::ptrdiff_t Read(char* to, std::size_t size);
  std::ptrdiff_t Write(const char* from, std::size_t size);
  // Waits for the socket to be readable or writable (POLLIN, POLLOUT).
  bool Wait(short events) const;
  // Tells the other side that nothing follows, and takes in what it may still be sending: closing
  // with bytes unread would throw away the answer on its way to the client.
  void FinishWriting();
  int fd() const { return socket_.get(); }

 private:
  Descriptor socket_;
  int stop_fd_;
  Clock::time_point deadline_ = Clock::time_point::max();
};

class HttpListener {
 public:
  // Binds and listens, but answers no client yet. Throws OptionError for an address that cannot be
  // (unknown host), OutputError for one that is not to be had (in use, no permission).
  explicit HttpListener(const HttpAddress& address);
  ~HttpListener() { Stop(); }

  // Starts `threads` threads; each calls `serve` with one connection after the other. `serve` must
  // not throw. The threads take no signals: those are for the program's own.
  void Start(std::size_t threads, const std::function<void(Connection&)>& serve);
  // Ends every wait, and returns when the threads have ended. May be called again.
  void Stop();

  int port() const { return port_; }
  bool loopback() const { return loopback_; }
  // Whether a new connection would find a thread.
  bool HasFreeThread() const { return free_ > 0; }

 private:
  void Accept(const std::function<void(Connection&)>& serve);

  Descriptor socket_, stop_;
  int port_ = 0;
  bool loopback_ = false;
  std::atomic<std::size_t> free_{0};  // threads that wait for a connection
  std::vector<std::thread> threads_;
};

}  // namespace lamina
