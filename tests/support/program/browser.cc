#include "tests/support/program/browser.h"

// Before httplib: the system's <resolv.h>, which that includes, makes a macro of a name in Eigen.
#include <Eigen/Core>

#include <httplib.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace lamina {
namespace {

constexpr int kPatienceS = 120;

nlohmann::json Value(const httplib::Result& answer) {
  if (!answer) throw std::runtime_error("chromedriver: " + httplib::to_string(answer.error()));
  const nlohmann::json value = nlohmann::json::parse(answer->body)["value"];
  if (answer->status == 200) return value;
  throw std::runtime_error("chromedriver: " + value["message"].get<std::string>());
}

}  // namespace

// chromedriver, and a session of it.
class Browser::Driver {
 public:
  Driver(const std::string& folder, int width, int height, bool phone) {
    StartDriver();
    try {
      StartSession(folder, width, height, phone);
    } catch (...) {
      EndDriver();
      throw;
    }
  }
  ~Driver() {
    client_->Delete(session_.c_str());
    EndDriver();
  }
  Driver(const Driver&) = delete;
  Driver& operator=(const Driver&) = delete;

  // Paths are those below the session's.
  nlohmann::json Post(const std::string& path, const nlohmann::json& body) {
    return Value(client_->Post((session_ + path).c_str(), body.dump(), "application/json"));
  }
  nlohmann::json Get(const std::string& path) {
    return Value(client_->Get((session_ + path).c_str()));
  }

 private:
  void StartDriver() {
    int out[2];
    if (pipe(out) != 0) throw std::runtime_error("no pipe");
    driver_ = fork();
    if (driver_ == 0) {
      setpgid(0, 0);
      dup2(out[1], STDOUT_FILENO);
      close(out[0]);
      close(out[1]);
      execl("/usr/bin/chromedriver", "chromedriver", "--port=0", static_cast<char*>(nullptr));
      _exit(127);
    }
    setpgid(driver_, driver_);
    close(out[1]);
    output_ = fdopen(out[0], "r");
    char line[1024];
    while (port_ == 0 && std::fgets(line, sizeof(line), output_) != nullptr) {
      const char* const found = std::strstr(line, "successfully on port ");
      if (found != nullptr) port_ = std::atoi(found + std::strlen("successfully on port "));
    }
    if (port_ != 0) return;
    EndDriver();
    throw std::runtime_error("chromedriver did not start");
  }

  void StartSession(const std::string& folder, int width, int height, bool phone) {
    client_ = std::make_unique<httplib::Client>("127.0.0.1", port_);
    client_->set_read_timeout(kPatienceS);
    nlohmann::json arguments = {
        "--headless=new",
        "--no-sandbox",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
        "--use-gl=angle",
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--force-device-scale-factor=1",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
        "--user-data-dir=" + folder,
        "--window-size=" + std::to_string(width) + "," + std::to_string(height)};
    nlohmann::json options = {{"binary", "/usr/bin/chromium"}, {"args", arguments}};
    if (phone) {
      options["mobileEmulation"]["deviceMetrics"] = {
          {"width", width}, {"height", height}, {"pixelRatio", 2.0}, {"touch", true}};
    }
    const nlohmann::json wanted = {
        {"browserName", "chrome"},
        {"goog:chromeOptions", options},
        {"goog:loggingPrefs", {{"browser", "ALL"}}},
        {"timeouts", {{"script", 1000 * kPatienceS}, {"pageLoad", 1000 * kPatienceS}}}};
    const nlohmann::json session = Post("/session", {{"capabilities", {{"alwaysMatch", wanted}}}});
    session_ = "/session/" + session["sessionId"].get<std::string>();
  }

  // The driver, and whatever of the browser is left.
  void EndDriver() {
    kill(-driver_, SIGTERM);
    waitpid(driver_, nullptr, 0);
    if (output_ != nullptr) std::fclose(output_);
  }

  pid_t driver_ = -1;
  int port_ = 0;
  std::FILE* output_ = nullptr;
  std::unique_ptr<httplib::Client> client_;
  std::string session_;
};

bool Browser::IsInstalled() {
  return access("/usr/bin/chromium", X_OK) == 0 && access("/usr/bin/chromedriver", X_OK) == 0;
}

Browser::Browser(const std::string& folder, int width, int height, bool phone)
    : driver_(std::make_unique<Driver>(folder, width, height, phone)) {}

Browser::~Browser() = default;

void Browser::Go(const std::string& url) { driver_->Post("/url", {{"url", url}}); }

nlohmann::json Browser::Run(const std::string& script) {
  return driver_->Post("/execute/sync", {{"script", script}, {"args", nlohmann::json::array()}});
}

nlohmann::json Browser::WaitFor(const std::string& expression) {
  const std::string script = "const done = arguments[0], end = Date.now() + " +
                             std::to_string(900 * kPatienceS) +
                             "; (function look() { let value = null; try { value = (" + expression +
                             "); } catch (error) {} if (value) return done(value); "
                             "if (Date.now() > end) return done(null); setTimeout(look, 50); })();";
  return driver_->Post("/execute/async", {{"script", script}, {"args", nlohmann::json::array()}});
}

std::vector<std::string> Browser::Errors() {
  std::vector<std::string> errors;
  for (const nlohmann::json& entry : driver_->Post("/se/log", {{"type", "browser"}})) {
    if (entry["level"] == "SEVERE") errors.push_back(entry["message"]);
  }
  return errors;
}

std::string Browser::Screenshot() { return driver_->Get("/screenshot").get<std::string>(); }

}  // namespace lamina
