"use strict";

const CONFIG = { responsive: true, displaylogo: false, displayModeBar: false };

function read(id) { return JSON.parse(document.getElementById(id).textContent); }

function drawCharts() {
  for (const [name, figure] of Object.entries(read("figures"))) {
    Plotly.newPlot(name, figure.data, figure.layout, CONFIG);
  }
}

function sortTable() {
  const table = document.getElementById("table");
  if (!table) return;
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => heading.firstElementChild.addEventListener("click", () => {
    const descending = heading.getAttribute("aria-sort") === "ascending";
    headings.forEach((other) => other.removeAttribute("aria-sort"));
    heading.setAttribute("aria-sort", descending ? "descending" : "ascending");
    const key = (row) => {
      const text = row.cells[column].textContent, number = parseFloat(text);
      return column && !Number.isNaN(number) ? number : text;
    };
    const order = (a, b) => (typeof a === "string" ? String(a).localeCompare(String(b)) : a - b);
    const rows = [...table.tBodies[0].rows].sort((a, b) => order(key(a), key(b)) * (descending ? -1 : 1));
    table.tBodies[0].append(...rows);
  }));
}

class Player {
  constructor(data) {
    this.data = data;
    this.frames = Math.max(...data.flights.map((flight) => flight.time.length));
    this.frame = 0;
    this.timer = null;
    this.button = document.getElementById("play");
    this.slider = document.getElementById("when");
    this.clock = document.getElementById("clock");
    this.button.addEventListener("click", () => (this.timer === null ? this.play() : this.pause()));
    this.slider.addEventListener("input", () => { this.pause(); this.show(Number(this.slider.value)); });
    this.drawn = Promise.all([...data.flights.map((flight, row) => this.drawMap(flight, row)), this.drawCourse()]);
    this.drawn.then(() => this.show(0));
  }

  drawMap(flight, row) {
    const { colours, window: view } = this.data;
    const line = (colour, width, dash) => ({ mode: "lines", line: { color: colour, width, dash } });
    const dot = (colour, symbol) => ({ mode: "markers", marker: { color: colour, size: 11, symbol,
      line: { color: colour, width: 2 } } });
    const traces = [line(colours.faint, 1), line(colours.emitter, 1.5, "dot"), line(colours.estimate, 1),
      line(colours.estimate, 2), line(colours.emitter, 3), line(colours.observer, 3),
      dot(colours.emitter, "circle"), dot(colours.observer, "circle"), dot(colours.estimate, "circle-open")];
    const axis = { gridcolor: colours.grid, zeroline: false, fixedrange: true, automargin: true, nticks: 6 };
    const layout = { margin: { l: 46, r: 6, t: 6, b: 44 }, showlegend: false, hovermode: false,
      font: { family: "system-ui, sans-serif", size: 13, color: colours.ink },
      xaxis: { ...axis, range: view.east, title: { text: "east, km" }, constrain: "domain" },
      yaxis: { ...axis, range: view.north, title: { text: "north, km" }, scaleanchor: "x", constrain: "domain" } };
    return Plotly.newPlot(`map-${row}`, traces.map((trace) => ({ ...trace, x: [], y: [] })), layout, CONFIG);
  }

  drawCourse() {
    const { grid, ink, policies } = this.data.colours;
    const colour = (row) => policies[row % policies.length];
    const traces = this.data.flights.flatMap((flight, row) => [
      { name: flight.name, x: flight.time, y: flight.error, mode: "lines", legendgroup: row,
        line: { color: colour(row), width: 2.5 } },
      { name: `${flight.name}, bound`, x: flight.time, y: flight.bound, mode: "lines", legendgroup: row, showlegend: false,
        line: { color: colour(row), width: 1.5, dash: "dash" } }]);
    const axis = { gridcolor: grid, zeroline: false, automargin: true };
    const layout = { height: 380, margin: { l: 56, r: 12, t: 12, b: 48 }, hovermode: "x",
      font: { family: "system-ui, sans-serif", size: 14, color: ink },
      legend: { orientation: "h", yanchor: "bottom", y: 1.02, x: 0 }, shapes: [this.cursor(0)],
      xaxis: { ...axis, title: { text: "time, s" }, range: [0, this.data.duration] },
      yaxis: { ...axis, title: { text: "error over range, %" }, type: "log", dtick: "D2", tickformat: "~g" } };
    return Plotly.newPlot("course", traces, layout, CONFIG);
  }

  cursor(time) {
    return { type: "line", x0: time, x1: time, y0: 0, y1: 1, yref: "paper", line: { color: this.data.colours.ink, width: 1 } };
  }

  show(frame) {
    this.frame = frame;
    this.slider.value = frame;
    const times = this.data.flights.map((flight, row) => this.showFlight(flight, row, frame));
    const now = Math.max(...times);
    this.clock.value = `${now.toFixed(0)} s`;
    this.slider.setAttribute("aria-valuetext", `${now.toFixed(0)} seconds`);
    Plotly.relayout("course", { shapes: [this.cursor(now)] });
  }

  showFlight(flight, row, frame) {
    const at = Math.min(frame, flight.time.length - 1);
    const until = (track) => ({ x: track.x.slice(0, at + 1), y: track.y.slice(0, at + 1) });
    const last = (track) => ({ x: [track.x[at]], y: [track.y[at]] });
    const join = (tracks) => ({ x: tracks.flatMap((track) => [...track.x, null]),
      y: tracks.flatMap((track) => [...track.y, null]) });
    const ring = { x: flight.ring.x.map((x) => x + flight.emitter.x[at]),
      y: flight.ring.y.map((y) => y + flight.emitter.y[at]) };
    const shown = [join(flight.bearings.slice(Math.max(0, at - 2), at + 1).flat()), ring, until(flight.estimate),
      flight.belief[at], until(flight.emitter), join(flight.platforms.map(until)), last(flight.emitter),
      join(flight.platforms.map(last)), last(flight.estimate)];
    Plotly.restyle(`map-${row}`, { x: shown.map((trace) => trace.x), y: shown.map((trace) => trace.y) });
    const percent = (value) => (value === null ? "unknown" : `${Number(value.toPrecision(2))} %`);
    document.getElementById(`state-${row}`).textContent =
      `error ${percent(flight.error[at])}, bound ${percent(flight.bound[at])}`;
    return flight.time[at];
  }

  play() {
    if (this.frame >= this.frames - 1) this.show(0);
    this.button.textContent = "Pause";
    this.timer = setInterval(() => {
      if (this.frame >= this.frames - 1) this.pause();
      else this.show(this.frame + 1);
    }, 100);
  }

  pause() {
    clearInterval(this.timer);
    this.timer = null;
    this.button.textContent = "Play";
  }
}

drawCharts();
sortTable();
const flights = read("flights");
if (flights) globalThis.player = new Player(flights);
