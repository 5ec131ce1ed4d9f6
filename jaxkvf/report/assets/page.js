// What the reader chooses, and what follows from it.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const map = decoded(data.colors, Uint8Array);
const before = data.surfaces[0];
const moved = data.displacement ? unscaled(data.displacement) : null;
const last = before.fields.length - 1;

const QUANTITIES = {
  speed: { name: "speed |U| · √area", values: (_, field) => field.speeds },
  strain: { name: "stretching ‖KU‖ · area", values: (_, field) => field.strains },
  ...(moved && { displacement: { name: "displacement / mean edge", values: () => moved } }),
};

function option(select, value, text) {
  select.append(new Option(text, value));
}

function describe() {
  const facts = before.facts;
  const loops = facts["boundary loops"];
  const pieces = facts.components > 1 ? `, ${facts.components} components` : "";
  const number = (n) => n.toLocaleString("en");
  $("facts").textContent =
    `${number(facts.vertices)} vertices, ${number(facts.faces)} faces, ${loops ? `${loops} boundary loop${loops > 1 ? "s" : ""}` : "closed"}` +
    `${pieces}; area ${brief(facts.area)}. Solved by ${facts.solver}.`;
  const verdicts = data.surfaces.map(({ name, fields }) => {
    const small = fields.filter((f) => f.dimensionless < data.exact);
    const exact = small.filter((f) => f.trusted).length;
    const coarse = small.length - exact;
    const lowest = brief(fields[0].dimensionless);
    const much = exact > last ? `${exact} or more` : exact || "no";
    const found = `${much} continuous ${exact > 1 ? "symmetries" : "symmetry"}, ${exact ? `λ·area < ${data.exact}` : `λ₀·area = ${lowest}`}`;
    const doubt = `${coarse} field${coarse > 1 ? "s" : ""} more on which the mesh is too coarse to tell`;
    const told = !coarse ? found : exact ? `${found}, and ${doubt}` : `too coarse to tell: the mesh has too few vertices for an energy this small to mean anything`;
    return (name ? `${name}: ` : "") + told + ". ";
  });
  $("verdict").textContent = verdicts.map((text) => text[0].toUpperCase() + text.slice(1)).join("");
}

/** Numbers of components, not more of them than fit. */
const listed = (numbers) => numbers.slice(0, 3).join(", ") + (numbers.length > 3 ? ", …" : "");

function tabulate(choose) {
  const two = data.surfaces.length > 1;
  const many = before.facts.components > 1;
  const head = ["field", ...(two ? ["λ·area before", "after"] : ["λ·area"]), many ? "mult." : "multiplicity", "period T", "closed", ...(many ? ["component"] : []), "residual"];
  const shown = data.surfaces[data.surfaces.length - 1].fields;
  const all = clusters(shown);
  const rows = shown.map((field, i) => {
    const { period } = field;
    const closed = period ? Math.round((100 * period.closed) / period.curves) : 0;
    const cells = [
      i,
      ...data.surfaces.map(({ fields }) => brief(fields[i].dimensionless) + (fields[i].trusted ? "" : "?")),
      multiplicity(all, field.cluster),
      closed >= 50 ? brief(period.time) : "–",
      `${closed} %`,
      ...(many ? [listed(field.components)] : []),
      field.residual.toExponential(0),
    ];
    const row = document.createElement("tr");
    cells.forEach((cell) => row.insertCell().append(String(cell)));
    row.addEventListener("click", () => choose(i));
    return row;
  });
  const header = document.createElement("tr");
  head.forEach((text) => header.append(Object.assign(document.createElement("th"), { textContent: text })));
  const table = $("numbers");
  table.createTHead().append(header);
  table.createTBody().append(...rows);
}

/** The picture; null where the browser has no WebGL. */
function makeStage() {
  const low = new THREE.Vector3(...before.low);
  const high = new THREE.Vector3(...before.high);
  const frame = { center: low.clone().add(high).multiplyScalar(0.5), scale: 2 / high.distanceTo(low) };
  const faces = decoded(data.faces, Uint32Array);
  try {
    return new Stage($("view"), data.surfaces.map((told) => new ShownMesh(told, faces, frame)), data.views[data.up]);
  } catch (failure) {
    console.warn(failure.message);
    $("apology").hidden = false;
    return null;
  }
}

Object.keys(data.views).forEach((name) => option($("up"), name, name));
$("up").value = data.up;
const stage = makeStage();

function update() {
  const index = Number($("field").value);
  document.querySelectorAll("#numbers tbody tr").forEach((row, i) => row.classList.toggle("chosen", i === index));
  document.querySelectorAll("#spectrum circle").forEach((dot) => dot.classList.toggle("chosen", Number(dot.dataset.field) === index));
  $("labels").replaceChildren(
    ...data.surfaces.map(({ name, fields }) => {
      const label = document.createElement("span");
      const strong = document.createElement("b");
      strong.textContent = name;
      label.append(strong, `${name ? ": " : `field ${index}: `}λ·area = ${brief(fields[index].dimensionless)}`);
      return label;
    }),
  );
  if (!stage) return;
  const quantity = QUANTITIES[$("color").value];
  const values = stage.surfaces.map((surface) => quantity.values(surface, surface.fields[index]));
  const most = Math.max(...values.map(largest));
  $("most").textContent = brief(most);
  $("quantity").textContent = quantity.name;
  stage.surfaces.forEach((surface, s) => {
    surface.paint(values[s], most, map);
    surface.show(index, { draw: $("draw").value, edges: $("edges").checked });
    surface.advance(periods);
  });
  stage.stale = true;
}

function choose(index) {
  $("field").value = String(Math.max(0, Math.min(last, index)));
  update();
}

let periods = 0;
let previous = null;
function tick(now) {
  if ($("play").checked && stage.surfaces.some(({ flow }) => flow?.visible)) {
    periods += previous === null ? 0 : (now - previous) / 1000 / SECONDS;
    stage.surfaces.forEach((surface) => surface.advance(periods));
    stage.stale = true;
  }
  previous = now;
  if (stage.stale) stage.render();
  requestAnimationFrame(tick);
}

before.fields.forEach((field, i) => option($("field"), i, `${i}: λ·area = ${brief(field.dimensionless)}`));
Object.entries(QUANTITIES).forEach(([key, { name }]) => option($("color"), key, name));
const stops = Array.from({ length: 17 }, (_, i) => `rgb(${map.slice(48 * i - (i === 16 ? 3 : 0)).slice(0, 3).join(",")})`);
$("ramp").style.background = `linear-gradient(to right, ${stops.join(",")})`;
$("play").checked = !matchMedia("(prefers-reduced-motion: reduce)").matches;
describe();
tabulate(choose);
drawSpectrum($("spectrum"), data.surfaces, choose);
["field", "color", "draw", "edges"].forEach((id) => $(id).addEventListener("change", update));
$("up").addEventListener("change", () => stage?.lookFrom(data.views[$("up").value]));
$("home").addEventListener("click", () => stage?.lookFrom(data.views[$("up").value]));
document.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (step && !/^(SELECT|INPUT)$/.test(event.target.tagName)) choose(Number($("field").value) + step);
});
update();
if (stage) requestAnimationFrame(tick);
document.documentElement.dataset.ready = "yes";
