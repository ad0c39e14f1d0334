// What --help looks like.
#pragma once

namespace CLI {
class App;
}

namespace fraja::cli {

/// Gives the app and its commands our form of help: what an option takes beside its name; what it
/// is for, within which bounds and by default, in lines of at most a hundred letters.
void use_house_help(CLI::App& app);

} // namespace fraja::cli
