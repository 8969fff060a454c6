/** The element of the page with this id; the page is ours, so a missing one is a mistake of ours. */
export function byId<T extends HTMLElement>(id: string, kind: new () => T): T {
  const element = document.getElementById(id);
  if (!(element instanceof kind)) throw new Error(`the page lacks #${id}`);
  return element;
}

export const button = (id: string): HTMLButtonElement => byId(id, HTMLButtonElement);
export const select = (id: string): HTMLSelectElement => byId(id, HTMLSelectElement);
export const input = (id: string): HTMLInputElement => byId(id, HTMLInputElement);
export const element = (id: string): HTMLElement => byId(id, HTMLElement);

/** Calls `act` when the button is pressed. */
export function onPress(id: string, act: () => void): void {
  button(id).addEventListener('click', act);
}

/** Calls `act` with what is chosen. */
export function onChoice(id: string, act: (value: string) => void): void {
  const control = select(id);
  control.addEventListener('change', () => act(control.value));
}

export function setText(target: HTMLElement, text: string): void {
  if (target.textContent !== text) target.textContent = text;
}

/** Fills a select with [value, label] options where they differ from what it has, and chooses one. */
export function fillSelect(target: HTMLSelectElement, options: [string, string][], chosen: string): void {
  const wanted = options.map(([value, label]) => `${value}\n${label}`).join('\n\n');
  if (target.dataset['options'] !== wanted) {
    target.dataset['options'] = wanted;
    target.replaceChildren(...options.map(([value, label]) => new Option(label, value)));
  }
  if (target.value !== chosen) target.value = chosen;
}

export function setPressed(target: HTMLElement, on: boolean): void {
  target.setAttribute('aria-pressed', String(on));
}

export function setIcon(target: HTMLButtonElement, icon: string, label: string, title: string): void {
  target.querySelector('use')?.setAttribute('href', `#i-${icon}`);
  target.setAttribute('aria-label', label);
  target.title = title;
}

/** Offers parts as a file. */
export function download(parts: BlobPart[], name: string, type: string): void {
  const url = URL.createObjectURL(new Blob(parts, { type }));
  const link = document.createElement('a');
  link.href = url;
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

/** What was stored under a name, or null where nothing may be stored. */
export function remembered(name: string): string | null {
  try {
    return localStorage.getItem(`palpate.${name}`);
  } catch {
    return null;
  }
}

export function remember(name: string, value: string): void {
  try {
    localStorage.setItem(`palpate.${name}`, value);
  } catch {
    // a page without storage forgets
  }
}
