// Evaluates a FIS file with fuzzylite 6.0 at the points of a grid, for tests/peers/fis_peer.py.
//
// usage: fis_fuzzylite SYSTEM.fis GRID.txt       GRID.txt has the inputs of one point in each line
//
// build: g++ -std=c++14 -w -o fis_fuzzylite fis_fuzzylite.cpp -lfuzzylite       (libfuzzylite-dev of Debian)
//
// The console of fuzzylite cannot do this: it drops rules whose activation is below 1e-6, which is a share of the sum wherever all rules
// fire weakly. Here that limit is zero.

#include <fl/Headers.h>

#include <fstream>
#include <iostream>
#include <memory>
#include <sstream>

int main(int count, char** arguments) {
    if (count != 3) {
        std::cerr << "usage: fis_fuzzylite SYSTEM.fis GRID.txt\n";
        return 2;
    }
    fl::fuzzylite::setMachEps(0.0);
    std::unique_ptr<fl::Engine> engine(fl::FisImporter().fromFile(arguments[1]));
    std::ifstream grid(arguments[2]);
    std::cout.precision(17);
    for (std::string line; std::getline(grid, line);) {
        std::istringstream point(line);
        for (fl::InputVariable* input : engine->inputVariables()) {
            double value;
            if (!(point >> value)) {
                std::cerr << "too few inputs: " << line << "\n";
                return 1;
            }
            input->setValue(value);
        }
        engine->process();
        std::cout << engine->getOutputVariable(0)->getValue() << "\n";
    }
}
