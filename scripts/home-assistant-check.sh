#!/usr/bin/env bash
# Installs Home Assistant in a virtual environment, connects it with `radarllm live sim:` through mosquitto, and checks
# what it shows. To be run by hand: it downloads 0.8 GB from PyPI and takes some minutes.
#
#   scripts/home-assistant-check.sh [FOLDER]
#
# FOLDER keeps the virtual environment for the next time (default: work/home-assistant).
# It needs python3.13, mosquitto (Debian: apt-get install mosquitto) and a built radarllm ($RADARLLM, or
# target/release/radarllm).
# What is missing is named, and the exit code is then 77.
set -euo pipefail
cd "$(dirname "$0")/.."
folder=${1:-work/home-assistant}
radarllm=${RADARLLM:-target/release/radarllm}

missing() {
    echo "skipped: $1"
    exit 77
}
command -v mosquitto > /dev/null || [ -x /usr/sbin/mosquitto ] || missing "mosquitto is not installed"
[ -x "$radarllm" ] || missing "$radarllm is not built"
python=$(command -v python3.13 || true)
for found in "${PYENV_ROOT:-$HOME/.pyenv}"/versions/3.13*/bin/python3.13; do
    # A python3.13 on PATH may be a shim that does not run.
    if [ -x "$found" ] && ! "${python:-false}" --version > /dev/null 2>&1; then python=$found; fi
done
[ -n "$python" ] || missing "python3.13 is not on PATH"

if [ ! -x "$folder/venv/bin/hass" ]; then
    "$python" -m venv "$folder/venv"
    # The interface and the client of MQTT are not dependencies of the package; with --skip-pip nothing more is fetched.
    "$folder/venv/bin/pip" install --quiet \
        homeassistant==2025.4.4 paho-mqtt==2.1.0 home-assistant-frontend==20250411.0
fi
exec "$folder/venv/bin/python" scripts/home_assistant_check.py --hass "$folder/venv/bin/hass" --radarllm "$radarllm"
