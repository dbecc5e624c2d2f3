// A headless Chromium, driven by chromedriver over its HTTP interface (W3C WebDriver).
//
// It can reach nothing but 127.0.0.1: a page that wanted anything else would not work here.
#pragma once

// Before httplib: the system's <resolv.h>, which that includes, makes a macro of a name in Eigen.
#include <Eigen/Core>

#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace lamina {

class Browser {
 public:
  static bool IsInstalled() {
    return access("/usr/bin/chromium", X_OK) == 0 && access("/usr/bin/chromedriver", X_OK) == 0;
  }

  // `folder` takes the browser's own files. A phone has touch and two pixels in one.
  Browser(const std::string& folder, int width, int height, bool phone = false) {
    StartDriver();
    try {
      StartSession(folder, width, height, phone);
    } catch (...) {
      EndDriver();
      throw;
    }
  }

  ~Browser() {
    client_->Delete(session_.c_str());
    EndDriver();
  }
  Browser(const Browser&) = delete;
  Browser& operator=(const Browser&) = delete;

  void Go(const std::string& url) { Post(session_ + "/url", {{"url", url}}); }

  // The value that a script, the body of a function, returns.
  nlohmann::json Run(const std::string& script) {
    return Post(session_ + "/execute/sync",
                {{"script", script}, {"args", nlohmann::json::array()}});
  }

  // Waits until an expression is true in the page; its value, or null when patience is at an end.
  nlohmann::json WaitFor(const std::string& expression) {
    const std::string script =
        "const done = arguments[0], end = Date.now() + " + std::to_string(900 * kPatienceS) +
        "; (function look() { let value = null; try { value = (" + expression +
        "); } catch (error) {} if (value) return done(value); "
        "if (Date.now() > end) return done(null); setTimeout(look, 50); })();";
    return Post(session_ + "/execute/async",
                {{"script", script}, {"args", nlohmann::json::array()}});
  }

  // What the page and the browser have complained about since the last call.
  std::vector<std::string> Errors() {
    std::vector<std::string> errors;
    for (const nlohmann::json& entry : Post(session_ + "/se/log", {{"type", "browser"}})) {
      if (entry["level"] == "SEVERE") errors.push_back(entry["message"]);
    }
    return errors;
  }

  // A PNG, in base64.
  std::string Screenshot() {
    return Value(client_->Get((session_ + "/screenshot").c_str())).get<std::string>();
  }

 private:
  static constexpr int kPatienceS = 120;

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

  nlohmann::json Post(const std::string& path, const nlohmann::json& body) {
    return Value(client_->Post(path.c_str(), body.dump(), "application/json"));
  }

  static nlohmann::json Value(const httplib::Result& answer) {
    if (!answer) throw std::runtime_error("chromedriver: " + httplib::to_string(answer.error()));
    const nlohmann::json value = nlohmann::json::parse(answer->body)["value"];
    if (answer->status == 200) return value;
    throw std::runtime_error("chromedriver: " + value["message"].get<std::string>());
  }

  pid_t driver_ = -1;
  int port_ = 0;
  std::FILE* output_ = nullptr;
  std::unique_ptr<httplib::Client> client_;
  std::string session_;
};

}  // namespace lamina
