// Draws every plot of a report from the JSON beside it, and ties the plots of a group together.
"use strict";
(() => {
  const theme = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

  // "", "3", "ink", "muted" or a CSS color, as in report.h.
  function color(series, index) {
    if (series.color === "") return theme("series-" + ((index % 8) + 1));
    if (/^[1-8]$/.test(series.color)) return theme("series-" + series.color);
    if (series.color === "ink" || series.color === "muted") return theme(series.color);
    return series.color;
  }

  // A value to a thousandth of the range that is shown, or finer.
  function readable(value, range) {
    if (value === null || value === undefined || Number.isNaN(value)) return "–";
    if (Math.abs(value) >= 1e6 || range < 1e-5) return value.toExponential(3).replace("-", "\u2212");
    const text = value.toFixed(Math.max(0, Math.min(9, 3 - Math.floor(Math.log10(range)))));
    return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
  }
  const extent = ([low, high]) => Math.abs(high - low) || 1;

  // As many decimals as the distance between the ticks asks for.
  function tickText(value, granularity, option, graph) {
    const range = graph.yAxisRange ? extent(graph.yAxisRange()) : 1;
    return ticks(value, range);
  }
  function timeTickText(value, granularity, option, graph) {
    const range = graph.xAxisRange ? extent(graph.xAxisRange()) : 1;
    return ticks(value, range);
  }
  function ticks(value, range) {
    if (Math.abs(value) < range * 1e-9) return "0";
    if (Math.abs(value) >= 1e5 || range < 1e-4) return value.toExponential(1).replace("-", "\u2212");
    const text = value.toFixed(Math.max(0, Math.min(8, 2 - Math.floor(Math.log10(range)))));
    return (text.includes(".") ? text.replace(/\.?0+$/, "") : text).replace("-", "\u2212");
  }

  function text(name, content) {
    const span = document.createElement("span");
    span.className = name;
    span.textContent = content;
    return span;
  }

  class Plot {
    constructor(figure) {
      this.data = JSON.parse(figure.querySelector("script").textContent);
      if (this.data.rows.length === 0) throw new Error("it has no values");
      this.legend = figure.querySelector(".legend");
      this.canvas = figure.querySelector(".canvas");
      this.makeLegend();
      this.graph = new Dygraph(this.canvas, this.data.rows, this.options());
      this.tip = document.createElement("div");
      this.tip.className = "tip";
      this.tip.hidden = true;
      this.canvas.append(this.tip);
    }

    options() {
      const series = {};
      for (const s of this.data.series) {
        series[s.name] = { strokePattern: s.dashed ? [7, 4] : null, stepPlot: s.steps };
      }
      return {
        labels: ["x", ...this.data.series.map((s) => s.name)],
        series,
        legend: "never",
        xlabel: this.data.xLabel,
        valueRange: this.data.yRange,
        strokeWidth: 1.5,
        strokeBorderWidth: 0,
        connectSeparatedPoints: false,
        highlightCircleSize: 3.5,
        axisLabelFontSize: 13,
        xLabelHeight: 22,
        xRangePad: 4,
        yRangePad: 10,
        gridLineWidth: 1,
        axes: {
          x: { axisLabelFormatter: timeTickText, pixelsPerLabel: 80, axisLabelWidth: 70 },
          y: { axisLabelFormatter: tickText, axisLabelWidth: 52, pixelsPerLabel: 40 },
        },
        ...this.colors(),
        highlightCallback: (event, x) => { for (const plot of this.group) plot.point(x); },
        unhighlightCallback: () => { for (const plot of this.group) plot.unpoint(); },
        drawCallback: (graph, initial) => { if (!initial) this.shareZoom(); },
      };
    }

    colors() {
      return {
        colors: this.data.series.map((s, i) => color(s, i)),
        gridLineColor: theme("grid"),
        axisLineColor: theme("line"),
      };
    }

    color() {
      this.graph.updateOptions(this.colors());
      this.buttons.forEach((button, i) => {
        button.querySelector(".key").style.borderTopColor = color(this.data.series[i], i);
      });
    }

    makeLegend() {
      this.buttons = this.data.series.map((s, i) => {
        const button = document.createElement("button");
        button.type = "button";
        button.setAttribute("aria-pressed", "true");
        button.append(this.key(s, i), text("name", s.name));
        button.addEventListener("click", () => {
          const shown = button.getAttribute("aria-pressed") !== "true";
          button.setAttribute("aria-pressed", String(shown));
          this.graph.setVisibility(i, shown);
        });
        return button;
      });
      this.legend.append(...this.buttons);
    }

    // The sample of line beside a name.
    key(series, index) {
      const key = text(series.dashed ? "key dashed" : "key", "");
      key.style.borderTopColor = color(series, index);
      return key;
    }

    // Row whose x is nearest.
    rowAt(x) {
      const rows = this.data.rows;
      let low = 0, high = rows.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (rows[middle][0] <= x) low = middle; else high = middle;
      }
      return high >= 0 && Math.abs(rows[high][0] - x) < Math.abs(rows[low][0] - x) ? high : low;
    }

    point(x) {
      const index = this.rowAt(x), row = this.data.rows[index];
      if (!row) return;
      this.graph.setSelection(index);
      const range = extent(this.graph.yAxisRange());
      const [symbol, unit] = this.data.xLabel.split(", ");
      const at = document.createElement("div");
      at.className = "at";
      at.textContent = [symbol, readable(row[0], extent(this.graph.xAxisRange())), unit].join(" ");
      const lines = this.data.series.map((s, i) => {
        const line = document.createElement("div");
        line.className = "line";
        line.append(this.key(s, i), text("name", s.name), text("value", readable(row[i + 1], range)));
        return line;
      });
      this.tip.replaceChildren(at, ...lines.filter((_, i) => this.graph.visibility()[i]));
      this.tip.hidden = false;
      this.placeTip(this.graph.toDomXCoord(row[0]));
    }

    // Beside the pointed place, on the side with more room.
    placeTip(x) {
      const right = x < this.canvas.clientWidth / 2;
      this.tip.style.left = right ? x + 14 + "px" : "auto";
      this.tip.style.right = right ? "auto" : this.canvas.clientWidth - x + 14 + "px";
    }

    unpoint() {
      this.graph.clearSelection();
      this.tip.hidden = true;
    }

    shareZoom() {
      if (Plot.sharing) return;
      Plot.sharing = true;
      const range = this.graph.xAxisRange();
      for (const plot of this.group) {
        if (plot === this) continue;
        const own = plot.graph.xAxisRange();
        if (own[0] !== range[0] || own[1] !== range[1]) plot.graph.updateOptions({ dateWindow: range });
      }
      Plot.sharing = false;
    }
  }
  Plot.sharing = true;  // until all plots are there

  const plots = [];
  for (const figure of document.querySelectorAll("figure.plot")) {
    try {
      plots.push(new Plot(figure));
    } catch (error) {  // one plot that cannot be drawn must not take the others along
      figure.querySelector(".canvas").textContent = "This plot could not be drawn: " + error.message;
    }
  }
  for (const plot of plots) {
    plot.group = plots.filter((other) => other === plot || (plot.data.group && other.data.group === plot.data.group));
  }
  Plot.sharing = false;
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    Plot.sharing = true;
    for (const plot of plots) plot.color();
    Plot.sharing = false;
  });
})();
