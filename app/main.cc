// The program rilievo: dispatches to its commands; one line for every error; Ctrl-C ends it within a second.
#include <fmt/format.h>
#include <malloc.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <new>
#include <thread>

#include "app/command.h"
#include "base/error.h"
#include "stages/images/library_setup.h"

namespace rilievo::app {
namespace {

constexpr auto kGrace = std::chrono::milliseconds(700);

/// Takes SIGINT and SIGTERM on a thread of its own: asks the run to stop, and after a grace leaves at once. That is safe at
/// any instant, because artifacts are published atomically.
void WatchSignals(engine::StopSource& stop) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([signals, &stop] {
    int signal = 0;
    sigwait(&signals, &signal);
    stop.RequestStop();
    std::this_thread::sleep_for(kGrace);
    static constexpr char kLine[] = "rilievo: cancelled; finished work is kept, run the same command to continue\n";
    [[maybe_unused]] const auto written = ::write(STDERR_FILENO, kLine, sizeof kLine - 1);
    ::_exit(kExitCancelled);
  }).detach();
}

/// Memory that a task frees goes back to the system at once, so that the peak of the process is the peak of its tasks;
/// libraries keep their threads and their chatter to themselves.
void PrepareProcess() {
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
  mallopt(M_TRIM_THRESHOLD, 4 << 20);
  mallopt(M_ARENA_MAX, 4);
  images::PrepareImageLibrary();
  signal(SIGPIPE, SIG_IGN);
  signal(SIGXFSZ, SIG_IGN);
}

int Main(int argc, char** argv) {
  // The context outlives main's frame: the signal thread may still look at it while the process ends.
  static ProgramContext context;
  PrepareProcess();
  WatchSignals(context.stop);
  CLI::App app("Rilievo: orientation of full-resolution photographs, with statistics", "rilievo");
  app.require_subcommand(1);
  app.set_version_flag("--version", "rilievo " RILIEVO_VERSION);
  app.failure_message(CLI::FailureMessage::simple);
  AddOrientCommand(app, context);
  AddPlanCommand(app, context);
  AddInfoCommand(app, context);
  AddReportCommand(app, context);
  AddExportCommand(app, context);
  AddSimulateCommand(app, context);
  for (CLI::App* command : app.get_subcommands({}))
    command->set_config("--options", "", "TOML file with any of these options (name = value); the command line goes first")->group("General");
  try {
    app.parse(argc, argv);
    return context.exit_code;
  } catch (const CLI::Success& success) {  // --help, --version
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::string line = error.what();
    for (char& c : line)
      if (c == '\n') c = ' ';
    fmt::print(stderr, "rilievo: {} (see rilievo --help)\n", line);
    return kExitUsage;
  } catch (const Cancelled&) {
    fmt::print(stderr, "rilievo: cancelled; finished work is kept, run the same command to continue\n");
    return kExitCancelled;
  } catch (const Error& error) {
    fmt::print(stderr, "rilievo: {}\n", error.what());
    return error.code() == ErrorCode::kUsage ? kExitUsage : kExitFailed;
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "rilievo: the machine has no memory left (lower --memory or --threads)\n");
    return kExitFailed;
  } catch (const std::exception& error) {
    fmt::print(stderr, "rilievo: unexpected error: {}\n", error.what());
    return kExitFailed;
  }
}

}  // namespace
}  // namespace rilievo::app

int main(int argc, char** argv) { return rilievo::app::Main(argc, argv); }
