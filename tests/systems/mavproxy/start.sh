# Usage: start.sh PORT FOLDER. MAVProxy catches what its modules raise, and prints it on stdout if it is asked to.
export HOME="$2" PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
exec "$RIOT_MAVLINK_PYTHON" "$(dirname "$RIOT_MAVLINK_PYTHON")/mavproxy.py" --master="tcp:127.0.0.1:$1" \
    --moddebug=4 --no-state --non-interactive --cmd="wp list;fence list;rally list" 1>&2
