// λ·area against the number of the field, on a logarithmic scale, as SVG.

const brief = (value) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e-3 && size < 1e5 ? String(Number(value.toPrecision(4))) : value.toExponential(1);
};

function element(name, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
  if (text !== undefined) made.textContent = text;
  return made;
}

/** Members of each cluster of equal eigenvalues, in order. */
function clusters(fields) {
  const found = [];
  fields.forEach((field, i) => (found[field.cluster] ??= []).push(i));
  return found;
}

const multiplicity = (all, cluster) => (cluster === all.length - 1 ? "≥ " : "") + all[cluster].length;

/** Draws the chart; calls choose(i) for a click on field i. */
function drawSpectrum(svg, surfaces, choose) {
  const [width, height, left, right, top, bottom] = [366, 180, 40, 10, 20, 22];
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const positive = surfaces.flatMap(({ fields }) => fields.map((f) => f.dimensionless)).filter((v) => v > 0);
  const high = Math.ceil(Math.log10(Math.max(1, ...positive)));
  const low = Math.min(high - 2, Math.floor(Math.log10(Math.min(1, ...positive))));
  const count = surfaces[0].fields.length;
  const x = (i) => left + ((i + 0.5) / count) * (width - left - right);
  const y = (value) => {
    const share = (Math.log10(Math.max(value, 10 ** low)) - low) / (high - low);
    return height - bottom - share * (height - top - bottom);
  };
  const step = Math.ceil((high - low) / 5);
  for (let power = high; power >= low; power -= step) {
    svg.append(element("line", { class: "axis", x1: left, x2: width - right, y1: y(10 ** power), y2: y(10 ** power), opacity: 0.5 }));
    const label = power === 0 ? "1" : power === 1 ? "10" : `1e${power}`;
    svg.append(element("text", { x: left - 8, y: y(10 ** power) + 4, "text-anchor": "end" }, label));
  }
  for (let i = 0; i < count; i += Math.ceil(count / 12)) {
    svg.append(element("text", { x: x(i), y: height - 4, "text-anchor": "middle" }, i));
  }
  surfaces.forEach(({ fields }, s) => {
    const kind = s ? " second" : "";
    const all = clusters(fields);
    all.forEach((members, cluster) => {
      if (members.length < 2) return;
      const points = members.map((i) => `${x(i)},${y(fields[i].dimensionless)}`).join(" ");
      svg.append(element("polyline", { class: `cluster${kind}`, points }));
      const last = members[members.length - 1];
      const at = { x: (x(members[0]) + x(last)) / 2, y: y(fields[last].dimensionless) - 13, "text-anchor": "middle" };
      svg.append(element("text", at, `${multiplicity(all, cluster)}×`));
    });
    fields.forEach((field, i) => {
      const dot = element("circle", { class: kind.trim(), cx: x(i), cy: y(field.dimensionless), r: 5, "data-field": i });
      dot.append(element("title", {}, `field ${i}: λ·area = ${brief(field.dimensionless)}`));
      dot.addEventListener("click", () => choose(i));
      svg.append(dot);
    });
  });
}
