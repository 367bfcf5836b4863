// The program rilievo: dispatches to its commands; one line for every error; Ctrl-C ends it within a second.
#include <malloc.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <new>
#include <thread>

#include "app/command.h"
#include "base/error.h"
#include "stages/images/library_setup.h"

namespace rilievo::app {
namespace {

constexpr auto kGrace = std::chrono::milliseconds(700);

/// Said once: a program that takes longer than the grace to end meets its signal thread.
void PrintCancelled(ProgramContext& context) {
  if (!context.cancel_told.exchange(true))
    PrintError(context, "cancelled; finished work is kept, run the same command to continue");
}

/// Takes SIGINT and SIGTERM on a thread of its own: asks the run to stop, and after a grace leaves at once. That is
/// safe at any instant, because artifacts are published atomically.
void WatchSignals(ProgramContext& context) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  std::thread([signals, &context] {
    int signal = 0;
    sigwait(&signals, &signal);
    context.stop.RequestStop();
    std::this_thread::sleep_for(kGrace);
    {
      const std::lock_guard lock(context.before_exit_mutex);
      if (context.before_exit) context.before_exit();
    }
    PrintCancelled(context);
    ::_exit(kExitCancelled);
  }).detach();
}

/// Memory of large blocks (images, tables) goes back to the system at once when a task frees it, so that the peak of
/// the process is the peak of its tasks; up to 16 MiB of small ones stay, because every new page costs a fault;
/// libraries keep their threads and their chatter to themselves.
void PrepareProcess() {
  mallopt(M_MMAP_THRESHOLD, 4 << 20);
  mallopt(M_TRIM_THRESHOLD, 16 << 20);
  mallopt(M_ARENA_MAX, 4);
  images::PrepareImageLibrary();
  signal(SIGPIPE, SIG_IGN);
  signal(SIGXFSZ, SIG_IGN);
}

/// Runs the command line; every error becomes one line.
int Dispatch(CLI::App& app, int argc, char** argv, ProgramContext& context) {
  try {
    app.parse(argc, argv);
    return context.exit_code;
  } catch (const CLI::Success& success) {  // --help, --version
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    std::string line = error.what();
    for (char& c : line)
      if (c == '\n') c = ' ';
    PrintError(context, line + " (see rilievo --help)");
    return kExitUsage;
  } catch (const Cancelled&) {
    PrintCancelled(context);
    return kExitCancelled;
  } catch (const Error& error) {
    PrintError(context, error.what());
    return error.code() == ErrorCode::kUsage ? kExitUsage : kExitFailed;
  } catch (const std::bad_alloc&) {
    PrintError(context, "the machine has no memory left (lower --memory or --threads)");
    return kExitFailed;
  } catch (const std::exception& error) {
    PrintError(context, std::string("unexpected error: ") + error.what());
    return kExitFailed;
  }
}

/// A result that could not be written is no success: a full disk behind stdout is named. A closed pipe stays quiet.
int FlushOutput(const ProgramContext& context, int exit_code) {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return exit_code;
  if (errno != EPIPE) PrintError(context, "the output cannot be written (is the disk full?)");
  return exit_code == kExitDone ? kExitFailed : exit_code;
}

int Main(int argc, char** argv) {
  static ProgramContext& context = *new ProgramContext;  // never destroyed: the signal thread may look at it to the end
  PrepareProcess();
  WatchSignals(context);
  CLI::App app("Rilievo: orientation of full-resolution photographs, with statistics", "rilievo");
  app.require_subcommand(1);
  app.set_version_flag("--version", "rilievo " RILIEVO_VERSION);
  app.footer("Each command has its own help and example: rilievo COMMAND --help");
  AddOrientCommand(app, context);
  AddPlanCommand(app, context);
  AddInfoCommand(app, context);
  AddReportCommand(app, context);
  AddExportCommand(app, context);
  AddProfileCommand(app, context);
  AddVerifyCommand(app, context);
  AddCleanCommand(app, context);
  AddFeaturesCommand(app, context);
  AddSimulateCommand(app, context);
  return FlushOutput(context, Dispatch(app, argc, argv, context));
}

}  // namespace
}  // namespace rilievo::app

int main(int argc, char** argv) { return rilievo::app::Main(argc, argv); }
