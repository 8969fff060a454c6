// Light or dark: what the system wants until someone chooses.
import { remember, remembered } from './dom.ts';

export type Theme = 'light' | 'dark';

export class ThemeSwitch {
  private chosen = remembered('theme') as Theme | null;
  private readonly system = window.matchMedia('(prefers-color-scheme: dark)');

  constructor(private readonly changed: (theme: Theme) => void) {
    this.system.addEventListener('change', () => this.apply());
  }

  get theme(): Theme {
    if (this.chosen === 'light' || this.chosen === 'dark') return this.chosen;
    return this.system.matches ? 'dark' : 'light';
  }

  apply(): void {
    document.documentElement.dataset['theme'] = this.theme;
    this.changed(this.theme);
  }

  toggle(): void {
    this.chosen = this.theme === 'dark' ? 'light' : 'dark';
    remember('theme', this.chosen);
    this.apply();
  }
}
